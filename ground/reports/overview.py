"""One picture that tells a run: bound, error and limit on a logarithmic axis, modes as bands."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flightsw.icd.enums import Mode
from ground.reports import style
from ground.reports.run_folder import Run

CHARACTER_WIDTH = 0.0072  # of the ribbon's width, at the size of its words
MODE_WORDS = {mode.value: mode.name for mode in Mode}
SHORT_WORDS = {Mode.INTEGRATED: "INTEGR.", Mode.AUTONOMOUS: "AUTO"}


def overview(run: Run) -> Figure:
    """Bound against error and limit over the run; modes as coloured bands; outages, flag, crossing named."""
    figure, (axes,) = style.new_figure(1, _title(run), _subtitle(run))
    unit_s = style.time_axis(axes, run.t_s[0], run.t_s[-1], "time since start")
    labels = style.place_events(axes, _events(run, unit_s))
    figure.subplots_adjust(top=style.head_room(labels), bottom=0.175)
    error, bound = run.error_m, run.bound_m
    axes.set_yscale("log")
    e = style.buckets(run.t_s, np.where(error > 0.0, error, np.nan))
    axes.fill_between(e.t / unit_s, e.low, e.high, color=style.ERROR, alpha=0.25, lw=0)
    axes.plot(e.t / unit_s, e.rms, color=style.ERROR, lw=1.6, label="true error, largest axis (rms, range)")
    t, b = style.thin(run.t_s, bound)
    axes.plot(t / unit_s, b, color=style.BOUND, lw=2.4, label="bound computed on board")
    if np.isfinite(run.limit_typical_m):
        axes.axhline(run.limit_typical_m, color=style.LIMIT, ls="--", lw=1.5, label="limit")
    axes.set_ylim(*_limits(e, bound, run.limit_typical_m))
    style.metres_ticks(axes)
    axes.set_ylabel("position error")
    axes.grid(which="minor", visible=False)
    for start_s, stop_s, mode in _spans(run):
        axes.axvspan(start_s / unit_s, stop_s / unit_s, color=_shade(mode), alpha=0.38, lw=0, zorder=0)
    _ribbon(figure, axes, run, unit_s)
    style.name_events(axes, labels)
    style.legend_in_header(figure, axes)
    return figure


def _title(run: Run) -> str:
    return run.scenario


def _subtitle(run: Run) -> str:
    if not run.outages:
        return "no GNSS outage in this run"
    outage = run.outages[0]
    length = f"GNSS lost for {outage.end_s - outage.start_s:.0f} s"
    if len(run.outages) > 1:
        length = f"first of {len(run.outages)} outages: {length}"
    if outage.flag_s is None and outage.crossed_s is None:
        return f"{length}; the error stays within the limit and the flag stays down"
    if outage.flag_s is None:
        return f"{length}; the error passes the limit and NO flag is raised"
    flag_age_s = outage.flag_s - outage.last_fix_s
    if outage.crossed_s is None:
        return f"{length}; flag raised at {flag_age_s:.0f} s, the error stays within the limit"
    lead_s = outage.crossed_s - outage.flag_s
    before = f"{abs(lead_s):.0f} s {'before' if lead_s >= 0 else 'AFTER'} the error passes the limit"
    return f"{length}; flag raised at {flag_age_s:.0f} s, {before}"


def _limits(error: style.Buckets, bound_m: np.ndarray, limit_m: float) -> tuple[float, float]:
    """Axis range: the whole bound and limit, and the error without its momentary passages through zero."""
    bounds = bound_m[np.isfinite(bound_m)]
    levels = error.rms[np.isfinite(error.rms) & (error.rms > 0.0)]
    highest = max(np.nanmax(error.high, initial=1.0), bounds.max(initial=1.0), np.nan_to_num(limit_m))
    lowest = min(levels.min(initial=1.0), bounds.min(initial=1.0))
    return float(0.3 * max(lowest, 1e-3)), float(2.2 * highest)


def _spans(run: Run) -> Iterator[tuple[float, float, int]]:
    """Stretches of one mode: start, stop, mode."""
    changes = np.flatnonzero(np.diff(run.mode)) + 1
    for first, after in zip(np.r_[0, changes], np.r_[changes, run.mode.size], strict=True):
        stop_s = run.t_s[after] if after < run.t_s.size else run.t_s[-1]
        yield float(run.t_s[first]), float(stop_s), int(run.mode[first])


def _shade(mode: int) -> str:
    return style.MODE_SHADES[mode] if 0 <= mode < len(style.MODE_SHADES) else style.FAINT


def _ribbon(figure: Figure, axes: Axes, run: Run, unit_s: float) -> None:
    """The modes in words on a band under the panel, so that colour alone says nothing."""
    box = axes.get_position()
    ribbon = figure.add_axes((box.x0, 0.03, box.width, 0.042))
    ribbon.set_xlim(axes.get_xlim())
    ribbon.set_ylim(0.0, 1.0)
    ribbon.set_axis_off()
    low, high = axes.get_xlim()
    for start_s, stop_s, mode in _spans(run):
        ribbon.axvspan(start_s / unit_s, stop_s / unit_s, color=_shade(mode), lw=0)
        word = MODE_WORDS.get(mode, str(mode))
        room = (stop_s - start_s) / unit_s / (high - low) / CHARACTER_WIDTH
        if len(word) > room:
            word = SHORT_WORDS.get(Mode(mode), word) if mode in MODE_WORDS else word
        if len(word) <= room:
            ribbon.text(
                (start_s + stop_s) / 2 / unit_s,
                0.47,
                word,
                ha="center",
                va="center",
                fontsize=8.5,
                color=style.INK,
            )
    ribbon.text(-0.008, 0.47, "mode", transform=ribbon.transAxes, ha="right", va="center", color=style.GREY)


def _events(run: Run, unit_s: float) -> Iterator[style.Event]:
    for outage in run.outages[:4]:
        yield style.Event(outage.start_s / unit_s, "GNSS lost", style.INK)
        if outage.flag_s is not None:
            bound_m = float(run.bound_m[np.searchsorted(run.t_s, outage.flag_s)])
            yield style.Event(outage.flag_s / unit_s, f"FLAG RAISED, bound {style.metres(bound_m)}", style.FLAG)
        if outage.crossed_s is not None:
            yield style.Event(outage.crossed_s / unit_s, "error passes the limit", style.LIMIT)
        if outage.end_s < run.t_s[-1]:
            yield style.Event(outage.end_s / unit_s, "GNSS back", style.INK)
        if outage.back_in_service_s is not None and outage.flag_s is not None:
            yield style.Event(outage.back_in_service_s / unit_s, "back in service", style.SERVICE)
