"""The pictures of one run: the paper's figures 1 to 5, and an overview that tells the story at a glance.

`make_figures(run_dir)` reads truth.npz, monitor.npz and, when present, estimate.npz and summary.json,
and writes PNG files into `run_dir/figures`. Errors are published minus true position in GCRF axes, at the
true instant at which the published time stamp was used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flightsw.icd.enums import Mode
from ground.reports import style
from ground.reports.overview import overview
from ground.reports.run_folder import Outage, Run, load_run

MAX_OUTAGE_PANELS = 3
SETTLING_S = 600.0
ERROR_SPAN_LINEAR_M = 100.0  # above this a figure over several decades needs a symmetric logarithm


def make_figures(run_dir: Path) -> list[Path]:
    """Draw every figure of the run; returns the files written. Raises NotARun for a folder that is no run."""
    run = load_run(Path(run_dir))
    folder = Path(run_dir) / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    drawings: tuple[tuple[str, Callable[[Run], Figure]], ...] = (
        ("0_overview.png", overview),
        ("1_coordinates.png", coordinates),
        ("2_integrated_error.png", integrated_error),
        ("3_acceleration_correction.png", acceleration_correction),
        ("4_mixed_mode_error.png", mixed_mode_error),
        ("5_outage_error_and_bound.png", outage_error_and_bound),
    )
    with style.styled():
        return [style.save(draw(run), folder / name) for name, draw in drawings]


def coordinates(run: Run) -> Figure:
    """Figure 1: inertial coordinates over the run [km]."""
    radius_km = np.linalg.norm(run.r_truth_gcrf_m, axis=1) / 1e3
    figure, (axes,) = style.new_figure(
        1,
        "Inertial coordinates",
        f"{run.scenario}: true position in GCRF; geocentric radius {radius_km.min():.0f} to {radius_km.max():.0f} km",
    )
    unit_s = style.time_axis(axes, run.t_s[0], run.t_s[-1], "time since start")
    _shade_outages(axes, run, unit_s)
    rows = style.thin_rows(run.t_s.size)
    for i, name in enumerate(style.AXIS_NAMES):
        axes.plot(
            run.t_s[rows] / unit_s,
            run.r_truth_gcrf_m[rows, i] / 1e3,
            color=style.AXIS_COLOURS[i],
            ls=("-", "--", "-.")[i],
            label=name,
        )
    axes.set_ylabel("position [km]")
    style.legend_above(axes)
    return figure


def integrated_error(run: Run) -> Figure:
    """Figure 2: largest-axis error with the published bound while the mode is INTEGRATED."""
    integrated = run.mode == Mode.INTEGRATED
    error = np.where(integrated, run.error_m, np.nan)
    bound = np.where(integrated & np.isfinite(run.bound_m), run.bound_m, np.nan)
    settled = _settled(run, integrated)
    rms_m = _rms(error[settled])
    fix_rms_m = _rms(np.max(np.abs(run.fix_error_m), axis=1)) if run.fix_error_m.size else float("nan")
    figure, (axes,) = style.new_figure(
        1,
        "Error in integrated mode",
        f"{run.scenario}: largest axis, rms {style.metres(rms_m)} against {style.metres(fix_rms_m)} "
        "of the fixes themselves",
    )
    unit_s = style.time_axis(axes, run.t_s[0], run.t_s[-1], "time since start")
    _shade_outages(axes, run, unit_s)
    e = style.buckets(run.t_s, error)
    axes.fill_between(e.t / unit_s, e.low, e.high, color=style.ERROR, alpha=0.25, lw=0)
    axes.plot(e.t / unit_s, e.rms, color=style.ERROR, label="error, largest axis (rms, range)")
    # Between fixes the bound steps up and down within the second: its range as a band, its lower edge as the line.
    b = style.buckets(run.t_s, bound)
    axes.fill_between(b.t / unit_s, b.low, b.high, color=style.BOUND, alpha=0.3, lw=0)
    axes.plot(b.t / unit_s, b.low, color=style.BOUND, lw=1.8, label="published bound (lowest, range)")
    if np.isfinite(fix_rms_m):
        axes.axhline(fix_rms_m, color=style.GREY, ls=":", lw=1.4, label="rms of the fixes, largest axis")
    tops = [_percentile(error[settled], 100), 1.15 * _percentile(bound[settled], 98), fix_rms_m]
    top = max((v for v in tops if np.isfinite(v)), default=1.0)
    axes.set_ylim(0.0, 1.12 * top)
    axes.set_ylabel("position error [m]")
    style.legend_above(axes)
    return figure


def acceleration_correction(run: Run) -> Figure:
    """Figure 3: the acceleration the onboard gravity lacks, true and as the filter estimates it."""
    known = run.da_estimate_mps2 is not None and run.da_estimate_t_s is not None
    largest = float(np.nanmax(np.abs(run.da_true_mps2))) if run.da_true_mps2.size else 0.0
    factor, unit = (1e3, "mm/s²") if largest >= 1e-4 else (1e6, "µm/s²")
    figure, axes = style.new_figure(
        3,
        "Acceleration correction dA",
        f"{run.scenario}: truth is the acceleration beyond central gravity in GCRF"
        + ("; the estimate also makes up for the onboard integrator" if known else "; no estimate recorded"),
    )
    unit_s = style.time_axis(axes[-1], run.t_s[0], run.t_s[-1], "time since start")
    span = 1.25 * largest * factor or 1.0
    for i, panel in enumerate(axes):
        _shade_outages(panel, run, unit_s, label=i == 0)
        if run.da_estimate_t_s is not None and run.da_estimate_mps2 is not None:
            a = style.buckets(run.da_estimate_t_s, run.da_estimate_mps2[:, i] * factor)
            panel.fill_between(a.t / unit_s, a.low, a.high, color=style.BOUND, alpha=0.22, lw=0)
            panel.plot(a.t / unit_s, a.mean, color=style.BOUND, label="filter's estimate (mean, range)")
            span = max(span, 1.1 * _percentile(np.abs(run.da_estimate_mps2), 99) * factor)
        panel.plot(
            run.da_t_s / unit_s,
            run.da_true_mps2[:, i] * factor,
            color=style.INK,
            ls="--",
            lw=1.4,
            label="true",
        )
        panel.set_ylabel(f"{style.AXIS_NAMES[i]} [{unit}]")
    for panel in axes:
        panel.set_ylim(-span, span)
    style.legend_above(axes[0])
    return figure


def mixed_mode_error(run: Run) -> Figure:
    """Figure 4: error of each axis over the whole run, outages shaded."""
    largest = _percentile(run.error_m, 100)
    wide = np.isfinite(largest) and largest > ERROR_SPAN_LINEAR_M
    scale = " (symmetric logarithm)" if wide else ""
    figure, axes = style.new_figure(
        3,
        "Error in mixed mode",
        f"{run.scenario}: signed error of each GCRF axis over the whole run{scale}; largest {style.metres(largest)}",
    )
    unit_s = style.time_axis(axes[-1], run.t_s[0], run.t_s[-1], "time since start")
    for i, panel in enumerate(axes):
        _shade_outages(panel, run, unit_s, label=i == 0)
        _mark_flags(panel, run, unit_s)
        if wide:
            panel.set_yscale("symlog", linthresh=10.0, linscale=0.8)
            decades = 10.0 ** np.arange(1, np.ceil(np.log10(largest)) + 0.01)
            decades = decades[1::2] if decades.size > 3 else decades
            panel.set_yticks(np.r_[-decades[::-1], 0.0, decades])
            panel.set_ylim(-1.6 * largest, 1.6 * largest)
        style.metres_ticks(panel)
        t, e = style.thin(run.t_s, run.error_gcrf_m[:, i], 900)
        panel.plot(t / unit_s, e, color=style.AXIS_COLOURS[i], lw=1.2)
        panel.axhline(0.0, color=style.GREY, lw=0.6)
        panel.set_ylabel(f"error {style.AXIS_NAMES[i]}")
    style.legend_above(axes[0])
    return figure


def outage_error_and_bound(run: Run) -> Figure:
    """Figure 5: signed errors with +-bound and +-limit over each outage, flag and crossing marked."""
    shown = run.outages[:MAX_OUTAGE_PANELS]
    if not shown:
        figure, (empty,) = style.new_figure(1, "Outage: error and bound", f"{run.scenario}: no outage in this run")
        empty.set_axis_off()
        empty.text(0.5, 0.5, "no outage in this run", ha="center", va="center", color=style.GREY, fontsize=14)
        return figure
    more = f" (first {len(shown)} of {len(run.outages)} outages)" if len(run.outages) > len(shown) else ""
    figure, axes = style.new_figure(
        len(shown),
        "Outage: error and bound",
        f"{run.scenario}: {_outage_story(shown[0])}{more}",
        sharex=False,
    )
    figure.subplots_adjust(hspace=0.75)
    for i, (panel, outage) in enumerate(zip(axes, shown, strict=True)):
        labels = _draw_outage(panel, run, outage)
        if i == 0:
            figure.subplots_adjust(top=style.head_room(labels))
        style.name_events(panel, labels)
        panel.set_ylabel("position error" if len(shown) == 1 else f"error, outage {i + 1}")
        if i == 0:
            style.legend_in_header(figure, panel)
        if i + 1 < len(shown):
            panel.set_xlabel("")
    return figure


def _draw_outage(axes: Axes, run: Run, outage: Outage) -> list[style.Label]:
    """Draw all but the event labels, which need the panel's final place; returns where they go."""
    stop_s = min(outage.end_s + 0.05 * (outage.end_s - outage.start_s), run.t_s[-1])
    window = (run.t_s >= outage.start_s - 0.02 * (outage.end_s - outage.start_s)) & (run.t_s <= stop_s)
    age_s = run.t_s[window] - outage.last_fix_s
    if age_s.size < 2:
        return []
    unit_s = style.time_axis(axes, age_s[0], age_s[-1], "age of the last accepted fix before the outage")
    error, bound, limit = run.error_gcrf_m[window], run.bound_m[window], run.limit_typical_m
    inside = run.t_s[window] <= outage.end_s
    reach = float(np.fmax(_percentile(np.abs(error[inside]), 100), _percentile(bound[inside], 100)))
    reach = max(1e-3, reach) if np.isfinite(reach) else 1.0
    # The bound of a saturated or a late table can run far past everything else: keep the errors readable.
    if np.isfinite(limit) and reach > 0.35 * limit:
        largest = float(np.nan_to_num(_percentile(np.abs(error[inside]), 100)))
        reach = min(reach, max(3.0 * limit, 1.3 * largest))
        reach = max(reach, 1.15 * limit)
    axes.set_ylim(-1.1 * reach, 1.1 * reach)
    rows = style.thin_rows(age_s.size)
    axes.fill_between(age_s[rows] / unit_s, -bound[rows], bound[rows], color=style.BOUND, alpha=0.13, lw=0)
    for sign in (1.0, -1.0):
        axes.plot(
            age_s[rows] / unit_s,
            sign * bound[rows],
            color=style.BOUND,
            lw=1.8,
            label="± bound" if sign > 0 else None,
        )
    if np.isfinite(limit) and limit <= 1.1 * reach:
        for sign in (1.0, -1.0):
            axes.axhline(sign * limit, color=style.LIMIT, ls="--", lw=1.3, label="± limit" if sign > 0 else None)
    elif np.isfinite(limit):
        axes.annotate(
            f"limit ± {style.metres(limit)} lies outside this scale",
            (0.01, 0.03),
            xycoords="axes fraction",
            color=style.LIMIT,
            fontsize=9.5,
        )
    for i, name in enumerate(style.AXIS_NAMES):
        t, e = style.thin(age_s, error[:, i])
        axes.plot(t / unit_s, e, color=style.AXIS_COLOURS[i], ls=("-", "--", "-.")[i], label=f"error {name}")
    style.metres_ticks(axes)
    return style.place_events(axes, _outage_events(outage, unit_s))


def _outage_events(outage: Outage, unit_s: float) -> Iterator[style.Event]:
    """Flag, crossing and the return of GNSS, at their ages."""
    if outage.flag_s is not None:
        age_s = outage.flag_s - outage.last_fix_s
        yield style.Event(age_s / unit_s, f"flag raised at {age_s:.0f} s", style.FLAG)
    if outage.crossed_s is not None:
        age_s = outage.crossed_s - outage.last_fix_s
        yield style.Event(age_s / unit_s, f"error passes the limit at {age_s:.0f} s", style.LIMIT)
    yield style.Event((outage.end_s - outage.last_fix_s) / unit_s, "GNSS back", style.INK)


def _outage_story(outage: Outage) -> str:
    parts = [f"outage of {outage.end_s - outage.start_s:.0f} s"]
    parts.append("flag not raised" if outage.flag_s is None else f"flag at {outage.flag_s - outage.last_fix_s:.0f} s")
    parts.append(
        "error stays within the limit"
        if outage.crossed_s is None
        else f"error crosses the limit at {outage.crossed_s - outage.last_fix_s:.0f} s"
    )
    return ", ".join(parts)


def _shade_outages(axes: Axes, run: Run, unit_s: float, label: bool = True) -> None:
    for i, outage in enumerate(run.outages):
        axes.axvspan(
            outage.start_s / unit_s,
            outage.end_s / unit_s,
            color=style.OUTAGE_SHADE,
            lw=0,
            zorder=0,
            label="GNSS outage" if i == 0 and label else None,
        )


def _mark_flags(axes: Axes, run: Run, unit_s: float) -> None:
    flags = [o.flag_s for o in run.outages if o.flag_s is not None]
    for i, flag_s in enumerate(flags):
        axes.axvline(flag_s / unit_s, color=style.FLAG, lw=1.2, label="flag raised" if i == 0 else None)


def _settled(run: Run, integrated: np.ndarray) -> np.ndarray:
    """INTEGRATED epochs without the first ten minutes: how the filter starts must not set the scale."""
    settled = integrated & (run.t_s > run.t_s[0] + SETTLING_S)
    return settled if settled.any() else integrated


def _rms(values: Iterable[float] | np.ndarray) -> float:
    finite = np.asarray(values)[np.isfinite(np.asarray(values))]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else float("nan")


def _percentile(values: np.ndarray, percent: float) -> float:
    finite = values[np.isfinite(values)]
    return float(np.percentile(finite, percent)) if finite.size else float("nan")
