"""What `ground derivative study` prints of each part."""

from __future__ import annotations

from typing import Any

_WORDS = {
    "causal": "several models, causal",
    "smoothed": "fixed lag of 30 s",
    "paper": "the paper's algorithm",
    "printed": "the printed gain",
    "savitzky_golay": "local polynomial (sees ahead)",
    "pynumdiff_rts": "pynumdiff, Kalman (sees all)",
    "pynumdiff_savgol": "pynumdiff, Savitzky-Golay",
}


def lines(part: str, document: dict[str, Any]) -> list[str]:
    """Lines of one part."""
    return {"scenario": _scenario, "paper": _paper, "monitor": _monitor}[part](document)


def _scenario(found: dict[str, Any]) -> list[str]:
    answer = [
        f"the paper's scenario, {found['runs']} unseen runs: RMS errors, worst run in brackets, transients apart",
        f"{'':32} "
        + " ".join(f"{w:>20}" for w in ("velocity straight", "yawing [m/s]", "accel. straight", "yawing [m/s2]"))
        + f" {'transients':>11}",
    ]
    for name, one in found["estimators"].items():
        rms, worst = one["rms"], one["worst_run"]
        cells = [
            "-" if rms[key] is None else f"{rms[key]:.4f} ({worst[key]:.4f})"
            for key in ("v_straight", "v_yawing", "a_straight", "a_yawing")
        ]
        answer.append(f"{_WORDS[name]:32} " + " ".join(f"{c:>20}" for c in cells) + f" {rms['v_transient']:>11.2f}")
    for name in ("causal", "smoothed"):
        limits = ", ".join(f"{limit:g}" for limit in found[f"{name}_limits"])
        answer.append(f"{_WORDS[name]}: wanted {limits}: {'met' if found[f'{name}_met'] else 'NOT met'}")
    shares = ", ".join(f"{name} {100 * share:.1f} %" for name, share in found["within_two_sigma"].items())
    answer.append(f"velocity errors within two of their own sigmas: {shares}")
    if found["pynumdiff"]:
        words = "; ".join(f"{_WORDS[name]}: {text}" for name, text in found["pynumdiff"]["parameters"].items())
        answer.append(f"pynumdiff {found['pynumdiff']['version']}: {words}")
    else:
        from ground.derivative.peers import ABSENT

        answer.append(ABSENT)
    return answer


def _paper(found: dict[str, Any]) -> list[str]:
    best = found["best_of_both"]
    return [
        "the paper's algorithm:",
        f"  printed gain: spectral radius {found['radius_si']:.5f} in SI, {found['radius_normalised']:.5f} in "
        f"normalised units; straight, its own transient over, {found['printed_late']:.3f} m/s",
        f"  best constant gain: {best['figures'][0]:.3f} m/s straight, {best['figures'][1]:.3f} yawing: "
        f"{found['best_share']:.1f} times a claim",
        f"  argmin of the printed J of one epoch: K1 = {found['literal_gain']:.6f}",
    ]


def _monitor(found: dict[str, Any]) -> list[str]:
    answer = ["velocity check: fixes of 10 m and 0.1 m/s at 1 Hz"]
    for name, one in found["alarms"].items():
        answer.append(
            f"  false alarms, {name}: {one['count']} in {one['days']:.0f} days: {one['per_30_days']:.3f} in 30 days, "
            f"95 % limits {one['lower']:.3f} to {one['upper']:.3f}"
        )
    for name, (known, unknown) in found["limits"].items():
        answer.append(
            f"  0.05 m/s on one axis within 120 s, at most by any test at one alarm in 30 days, {name}: "
            f"{100 * known:.1f} % (direction known), {100 * unknown:.1f} % (not known)"
        )
    for name, rows in found["delays"].items():
        for row in rows:
            if abs(row["bias_mps"] - 0.05) < 1e-9:
                answer.append(
                    f"  0.05 m/s, {name}: median {row['median_s']:.0f} s, 95 % {row['q95_s']:.0f} s, within 120 s "
                    f"{100 * row['within']:.1f} % ({100 * row['within_lower']:.1f} to {100 * row['within_upper']:.1f})"
                )
    return answer
