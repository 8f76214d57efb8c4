"""Documents of the study's parts in words."""

from __future__ import annotations

from typing import Any

from ground.crosslink.study import REQUIREMENTS


def lines(part: str, found: dict[str, Any]) -> list[str]:
    """What a part found, as lines of text."""
    return ["", f"== {part}", *_PARTS[part](found)]


def _paper(found: dict[str, Any]) -> list[str]:
    listed = " ".join(map(str, found["neighbours_of_1"]))
    text = [
        f"threshold {found['threshold_m']:.2f} m, from Table 2 by 12 sigma of one satellite's position (paper: 59.7)",
        f"neighbours of satellite 1: {listed}; mean {found['mean_neighbours']:.2f}",
        "table  fault           dR healthy rms  (model)  excess mean  (model)  least   KS p   first majority  (model)",
    ]
    for one in found["tables"]:
        middle, low, high = one["first_model_s"]
        text.append(
            f"{one['number']:5d}  {one['fault']:14s}  {one['healthy_rms_m']:14.1f}  {one['model_rms_m']:7.1f}  "
            f"{one['excess_mean_m']:11.2f}  {one['model_excess_mean_m']:7.2f}  {one['excess_least_m']:5.2f}  "
            f"{one['ks_p']:5.3f}  {one['first_printed_s']:14.0f}  {middle:.0f} ({low:.0f} to {high:.0f})"
        )
        if one["equal_columns"]:
            pairs = ", ".join(f"{a} and {b}" for a, b in one["equal_columns"])
            text.append(f"       columns equal to the centimetre after the jump: {pairs}")
    return text


def _uploads(found: dict[str, Any]) -> list[str]:
    text = [
        f"{found['healthy']} healthy uploads in {found['runs']} geometries, claimed rate {found['p_false_alarm']:g}"
    ]
    for name, one in found["false"].items():
        text.append(
            f"  {name:8s} {one['count']} false alarms; 95 % limits of the rate {one['lower']:.2g} to {one['upper']:.2g}"
        )
    text.append(f"  a link of the own satellite beyond the paper's threshold: {found['link_beyond']} uploads")
    own = found["own_statistic"]
    text.append(f"  own statistic against chi-square: distance {own['distance']:.1e} (1 % level {own['expected']:.1e})")
    text.append(
        "case                          trials  majority  own fault  own suspect   named  exactly  worst geometry"
    )
    for row in found["cases"]:
        text.append(
            f"{row['case']:28s}  {row['trials']:6d}  {row['majority']:8.4f}  {row['own_fault']:9.4f}  "
            f"{row['own_suspect']:11.4f}  {row['named']:6.4f}  {row['exact']:7.4f}  {row['worst_geometry']:14.3f}"
        )
    return text


def _tail(found: dict[str, Any]) -> list[str]:
    rates = [one["rate"] for one in found["geometries"]]
    errors = max(one["error"] for one in found["geometries"])
    return [
        f"false alarms of the test of one epoch, by importance sampling: {min(rates):.3g} to {max(rates):.3g} an epoch "
        f"(standard error {errors:.1g}; bound {found['geometries'][0]['bound']:.3g}; claimed with slow faults "
        f"{found['claimed']:g})"
    ]


def _ramps(found: dict[str, Any]) -> list[str]:
    text = [
        "case               runs  network 10/50/90 %    own suspect 50 %  own fault 50 %  majority 50 %  named right"
    ]
    for row in found["cases"]:
        if not row["runs"]:
            continue
        spread = "/".join(_seconds(value) for value in row["network_s"])
        text.append(
            f"{row['case']:18s} {row['runs']:4d}  {spread:20s}  {_seconds(row['own_s'][1]):>16s}  "
            f"{_seconds(row['own_fault_s'][1]):>14s}  {_seconds(row['majority_s'][1]):>13s}  {row['named_right']:11d}"
        )
    beyond = ", ".join(f"{value:.4f} (of {key})" for key, value in found["slow_beyond"].items())
    text.append(
        f"before the ramps: {found['quiet_named']} findings in {found['quiet_epochs']} epochs of the network monitor, "
        f"{found['quiet_own']} of the own; {found['slow_tested']} slow statistics, beyond chi-square: {beyond}"
    )
    text.append("requirement                        time to alert  integrity")
    text += [f"{name:34s} {seconds:11.0f} s  {integrity}" for name, seconds, integrity in REQUIREMENTS]
    return text


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def _roc(found: dict[str, Any]) -> list[str]:
    at = min(range(len(found["rates"])), key=lambda k: abs(found["rates"][k] - 1e-4))
    text = [f"detection at {found['rates'][at]:g} false alarms an epoch: network / own / majority"]
    for a, jump in enumerate(found["jumps_m"]):
        cells = []
        for direction, name in enumerate(found["directions"]):
            values = [found[monitor][a][direction][at] for monitor in ("network", "own", "majority")]
            cells.append(name + " " + " / ".join("-" if v is None else f"{v:.3f}" for v in values))
        text.append(f"  {jump:4.0f} m  " + "   ".join(cells))
    return text


def _special(found: dict[str, Any]) -> list[str]:
    text = [
        f"{name}: {one['links']} links, rank {one['rank']} of {one['parameters']}, {one['undetectable']} undetectable"
        for name, one in found["rank"].items()
    ]
    text += [f"common {name}: statistics change by {value:.2g}" for name, value in found["common"].items()]
    text += [f"{row['case']}: found {row['found']:.3f}, exactly {row['exact']:.3f}" for row in found["plane"]]
    text += [
        f"{name}: 0.999 found in one epoch from {one['median']:.1f} m (median), {one['largest']:.1f} m (worst); by "
        f"the own satellite alone {one['own_median']:.1f} m"
        for name, one in found["certain_jump_m"].items()
    ]
    for links, known in found["known"].items():
        shares = ", ".join(f"{name} {one['mean']:.4f} (least {one['least']:.4f})" for name, one in known.items())
        text.append(f"{links}: of jumps of 70 m a test that knew satellite and direction would find {shares}")
    return text


def _speed(found: dict[str, Any]) -> list[str]:
    text = ["microseconds an epoch, least / median / 99 %; the processor's own time, median, and 99 % of a step:"]
    for name, one in found.items():
        if name != "load":
            times = " / ".join(f"{one[key]:.0f}" for key in ("least_us", "median_us", "p99_us"))
            own = f"{one['processor_us']:.0f}, {one['judged_us']:.0f} to the verdict, a step {one['step_p99_us']:.0f}"
            text.append(f"  {name}: {one['links']} links, {times}; {own}")
    return [*text, f"  load of the machine {found['load']:.1f}"]


def _day(found: dict[str, Any]) -> list[str]:
    text = []
    for name, one in found["flights"].items():
        sigma = ", ".join(f"{value:.2f}" for value in one["sigma_m"])
        rate = ", ".join(f"{1e3 * value:.2f}" for value in one["sigma_rate_mps"])
        certain = " / ".join(f"{value:.0f}" for value in one["certain_m"])
        text.append(f"{name} ({sigma} m; {rate} mm/s): rank {one['rank']} of {one['parameters']}")
        text.append(f"  found in one epoch with 0.999 from {certain} m radial / along / cross / clock")
        quick, on_air, slow = (one["expected"][name]["rate"] for name in ("quick", "on_air", "slow"))
        text.append(
            f"  false alarms expected of the day's own errors: {quick:.2g} an epoch of the test of one epoch, "
            f"{on_air:.2g} while nobody is excluded, {slow:.2g} of the search for slow faults; claimed 1e-7 each"
        )
        for flight in (one, *one["others"]):
            text.append(f"  seed {flight['seed']}: {flight['epochs']} epochs, {flight['false']} false findings")
            text += [_finding(finding) for finding in flight["findings"]]
    return text


def _finding(finding: dict[str, Any]) -> str:
    errors = ", ".join(f"{value:.1f}" for value in finding["errors_m"])
    return (
        f"    {finding['satellite']} from {_clock(finding['from_s'])} to {_clock(finding['to_s'])}, true error "
        f"{finding['size_m']:.1f} m ({errors}), at most {finding['largest_m']:.1f} m, "
        f"{'flagged healthy' if finding['healthy'] else 'flagged unhealthy'}, "
        f"{'slow' if finding['slow'] else 'quick'}, {finding['beyond']:.1f} robust sigma off"
    )


def _clock(seconds: float) -> str:
    whole = int(seconds)
    return f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}"


_PARTS = {
    "paper": _paper,
    "uploads": _uploads,
    "once": _uploads,
    "tail": _tail,
    "ramps": _ramps,
    "roc": _roc,
    "special": _special,
    "speed": _speed,
    "day": _day,
}
