"""Documents of the study and of a check in words."""

from __future__ import annotations

from typing import Any


def lines(part: str, found: dict[str, Any]) -> list[str]:
    """What a part found, as lines of text."""
    return {
        "alarms": _alarms,
        "detection": _detection,
        "exclusion": _exclusion,
        "protection": _protection,
        "speed": _speed,
        "inputs": _inputs,
        "peers": _peers,
    }[part](found)


def _alarms(found: dict[str, Any]) -> list[str]:
    text = [f"False alarms, {found['epochs']} epochs of each law, {found['mean_satellites']:.1f} satellites"]
    for law, tests in found["laws"].items():
        shares = (f"{name} {one['rate']:.5f} [{one['lower']:.5f}, {one['upper']:.5f}]" for name, one in tests.items())
        text.append(f"  {law:8} " + "; ".join(shares))
    return text


def _detection(found: dict[str, Any]) -> list[str]:
    text = [f"One biased satellite, {found['epochs']} epochs of each size: found with 50 % at, with 99 % at [sigmas]"]
    text += [
        f"  {name:10} {one['half']:.1f}  {one['nearly_all']:.1f}"
        for name, one in found.items()
        if isinstance(one, dict) and "share" in one
    ]
    return [*text, f"  theory, chi2 .05: {found['theory']['half']:.1f}  {found['theory']['nearly_all']:.1f}"]


def _exclusion(found: dict[str, Any]) -> list[str]:
    text = [
        "Exact fault set, alpha .001: mask, faults, size; the paper's rule; the flight's (lower 95 %), ambiguous, none"
    ]
    for case in found["cases"]:
        raw, flight = case["raw"], case["flight"]
        wanted = "" if case["wanted"] is None else f"  wanted {case['wanted']}"
        text.append(
            f"  {case['mask_deg']:.0f} deg, {case['faults']} of {case['sigmas']:.0f} sigma: {raw['rate']:.3f}   "
            f"{flight['rate']:.3f} ({flight['lower']:.3f}), {flight['ambiguous']}, {flight['none']} of "
            f"{flight['trials']}" + wanted
        )
    return text


def _protection(found: dict[str, Any]) -> list[str]:
    direct, ready = found["direct"], found["availability"]
    text = [
        f"Protection levels at P_HMI {direct['p_hmi']}, counted ({direct['faulty']} faulty epochs): "
        + ", ".join(
            f"{axis} {one['rate']:.1e} (upper {one['upper']:.1e})"
            for axis, one in zip(("east", "north", "up"), direct["axes"], strict=True)
        )
    ]
    for row in found["worst"]:
        risks = ", ".join(
            f"{one['risk']:.1e} (upper {one['risk_upper']:.1e}) of {allowed:.1e}"
            for one, allowed in zip(row["axes"], row["allowed"], strict=True)
        )
        text.append(f"  fault of {row['sigmas']:.0f} sigmas, prior x rate of what is allowed, E, N, U: {risks}")
    levels = "; ".join(" / ".join(f"{value:.1f}" for value in row) for row in ready["quantiles_m"])
    text.append(
        f"  LEO, limit {ready['limit_m']:.0f} m: available {ready['available']['rate']:.4f} "
        f"(lower {ready['available']['lower']:.4f}); levels E; N; U, 50 / 95 / 99.9 %: {levels} m"
    )
    return text


def _speed(found: dict[str, Any]) -> list[str]:
    text = [f"Microseconds of processor time an epoch, {found['satellites']} satellites (load {found['load']:.1f})"]
    return text + [
        f"  {name:27} least {one['least_us']:.0f}, median {one['median_us']:.0f}, 99 % {one['p99_us']:.0f}"
        for name, one in found.items()
        if isinstance(one, dict)
    ]


def _inputs(found: dict[str, Any]) -> list[str]:
    return ["Bad inputs", *(f"  {name}: {verdict}" for name, verdict in found.items())]


def _peers(found: dict[str, Any]) -> list[str]:
    text = [
        f"Beside gnss_lib_py {found['version']} (its limit times {found['factor']:g}, best of a grid), clocks agree: "
        "mask, faults; exact sets of gnss_lib_py, the paper's rule, flight, flight with one clock; us an epoch"
    ]
    return text + [
        f"  {case['mask_deg']:.0f} deg, {case['faults']} of {case['sigmas']:.0f} sigma: "
        + "   ".join(f"{case[name]['rate']:.3f}" for name in ("gnss_lib_py", "raw", "flight", "flight_one_clock"))
        + f"   {case['gnss_lib_py_us']:.0f} {case['flight_us']:.0f}"
        for case in found["cases"]
    ]


def check_lines(found: dict[str, Any]) -> list[str]:
    """What a check of a file found."""
    verdicts = ", ".join(f"{count} {name}" for name, count in found["verdicts"].items())
    text = [
        f"{found['file']}: {found['epochs']} epochs, {found['satellites']:.1f} satellites used: {verdicts}",
        f"  left out: {found['rows_excluded']} of {found['rows']} ranges "
        + ", ".join(f"{name} {count}x" for name, count in found["excluded"].items()),
        "  residuals, rms: " + ", ".join(f"{name} {rms:.2f} m" for name, rms in found["residual_rms_m"].items()),
        "  biases to GPS: "
        + ", ".join(f"{name} {mean:+.2f} m (1-sigma {std:.2f})" for name, (mean, std) in found["biases_m"].items()),
    ]
    if found["protection_m"]:
        text.append(
            "  protection levels E, N, U, median: " + " ".join(f"{v:.1f}" for v in found["protection_m"]) + " m"
        )
    if "enu_mean_m" in found:
        text.append(
            f"  against the header, E N U: mean {_three(found['enu_mean_m'])} m, 1-sigma "
            f"{_three(found['enu_std_m'])} m; "
            f"horizontal mean {found['horizontal_mean_m']:.2f} m"
        )
    for one in found.get("injected", []):
        text.append(
            f"  {one['faults']} injected: all removed {one['removed']['rate']:.4f} "
            f"(lower {one['removed']['lower']:.4f}), each {one['each_removed']['rate']:.4f}; wrong exclusions in "
            f"{one['wrong_sets']['count']} of {one['wrong_sets']['trials']}, ambiguous {one['ambiguous']}, "
            f"no answer {one['no_answer']}; "
            f"largest missed {one['largest_missed_m']:.0f} m; fix moved by {one['moved_m']:.1f} m (99 %)"
        )
    return text


def _three(values: list[float]) -> str:
    return ", ".join(f"{value:+.2f}" for value in values)
