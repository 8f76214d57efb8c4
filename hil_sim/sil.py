"""Software in the loop: the composition root of a whole run, and the only place of the world that knows flight.

It builds the tables as the ground would, hands flight a bus and a clock, ticks world and flight in lockstep and
leaves a run folder that says everything that happened.
"""

from __future__ import annotations

import gc
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from flightsw import app
from flightsw.can_port import CanPort
from flightsw.clock import LockstepClock, PacedClock
from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import Certificate, RejectCause
from flightsw.icd.table_file import TableImage
from flightsw.icd.table_saturation import saturation
from flightsw.journal import Journal
from flightsw.main_loop import MainLoop
from flightsw.nav.flight_model import FLIGHT
from flightsw.onboard import Refused, open_link
from flightsw.process_account import ProcessAccount
from flightsw.provenance import identity
from ground.errors import OperatorError
from ground.reports.figures import make_figures
from ground.reports.verdict import render_verdict
from ground.tables.build import build_navigation
from ground.tables.certified import build_certified
from ground.tables.earth_orientation import build_earth_orientation
from ground.tables.forces import build_force_tables
from ground.tables.function_sets import build_function
from hil_sim import crosslink_evaluation
from hil_sim.bus import Monitor, VirtualBusPair
from hil_sim.errors import ScenarioError
from hil_sim.evaluation import evaluate_run
from hil_sim.pseudoranges import evaluation as pseudorange_evaluation
from hil_sim.scenario import LoadedScenario
from hil_sim.world import World, earth_orientation_file, space_weather_file

_MARGIN_NS = 3_600_000_000_000
_ESTIMATE_STEP_S = 10
_PROGRESS_TICKS = 500
_LIBRARIES = ("satkit", "satkit-data", "astropy-iers-data")  # of the world; flight names its own


def run(loaded: LoadedScenario, out_dir: Path, link: str | None = None, speed: float | None = None) -> int:
    """Fly a scenario and leave its record in `out_dir`; prints the verdict. Returns the exit status, 0 for done.

    Args: link, `udp:HOST:PORT` to send MAVLink to besides the log; speed, paced at real time times this factor, or None
    for as fast as the machine can. Either way world and flight go in lockstep and the logs are the same.

    Raises SimulationError where scenario, tables or arguments do not allow the run.
    """
    prepare_folder(out_dir)
    try:
        sink = open_link(link)
        tables = out_dir / "tables"
        navigation, orientation, forces = build_tables(loaded, tables)
        functions = app.load_function_tables(tables)
    except (OperatorError, Refused, app.PreflightFailed) as error:
        raise ScenarioError(str(error)) from error
    console = Console(stderr=True)
    with _progress(console) as progress:
        stage = progress.add_task("starting", total=None)
        period_ns = int(navigation.values["tick_period_ns"][0])
        world = World.build(loaded, period_ns, lambda text: progress.update(stage, description=text))
        journal = Journal(out_dir)
        try:
            with VirtualBusPair() as pair:
                clock = (
                    LockstepClock(world.counter0_ns)
                    if speed is None
                    else PacedClock(world.counter0_ns, period_ns, speed)
                )
                loop = app.build(
                    navigation,
                    orientation,
                    clock,
                    CanPort(lambda: pair.flight),
                    journal,
                    sink,
                    world.start_unix_ns,
                    lambda done, total, name: progress.update(
                        stage, description=f"compiling {name}", completed=done, total=total
                    ),
                    forces,
                    functions=functions,
                )
                monitor = Monitor(world.n_ticks)
                progress.update(stage, description=f"flying {loaded.scenario.name}", total=world.n_ticks, completed=0)
                with collector_at_rest():
                    account = ProcessAccount()
                    estimate = _fly(
                        world, loop, pair, monitor, clock, lambda tick: progress.update(stage, completed=tick)
                    )
                    wall_s = account.age_s()
                process = account.summary()
        finally:
            journal.close()
            sink.close()
        progress.update(stage, description="writing the record", total=None)
        world.save_truth(out_dir / "truth.npz")
        monitor.save(out_dir / "monitor.npz")
        np.savez(out_dir / "estimate.npz", t_gps_ns=estimate[0], da_mps2=estimate[1])
        summary = _summarise(loaded, world, loop, monitor, navigation, wall_s, out_dir)
        _write_json(out_dir / "run.json", _provenance(loaded, navigation, orientation, forces, functions))
        _write_json(out_dir / "timing.json", _timing(loop, wall_s, clock, process))
        _write_json(out_dir / "summary.json", summary)
        progress.update(stage, description="drawing figures")
        figures = make_figures(out_dir)
    print(render_verdict(summary))
    print(f"record and {len(figures)} figures in {out_dir}")
    return 0


def prepare_folder(out_dir: Path) -> None:
    """An empty folder for the run; ScenarioError where there can be none."""
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
        _clear(out_dir)
    except OSError as error:
        raise ScenarioError(f"--out {out_dir}: cannot be written ({error.strerror}); name another folder") from None


def _clear(out_dir: Path) -> None:
    """Take away what a former run left, so that no file of two runs is ever mixed."""
    for name in ("summary.json", "run.json", "timing.json", "can.log", "link.tlog"):
        (out_dir / name).unlink(missing_ok=True)
    for name in ("truth.npz", "monitor.npz", "estimate.npz"):
        (out_dir / name).unlink(missing_ok=True)
    for name in ("figures", "tables", "replay"):
        shutil.rmtree(out_dir / name, ignore_errors=True)


def build_tables(loaded: LoadedScenario, folder: Path) -> tuple[TableImage, TableImage, app.ForceTables | None]:
    """Build the tables into the run's folder and load them from there, as flight does anywhere else."""
    flight = loaded.scenario.flight
    start_ns = loaded.t_start_gps_ns
    stop_ns = start_ns + round(loaded.scenario.time.duration_s * 1e9)
    finals = earth_orientation_file(loaded)
    folder.mkdir(parents=True, exist_ok=True)
    if flight.table:
        navigation_image = build_navigation(flight.table_set, flight.table)
    else:
        navigation_image, _ = build_certified(flight.table_set)  # what it lacks flight says itself: UNCERTIFIED
    (folder / app.NAVIGATION_FILE).write_bytes(navigation_image)
    (folder / app.EARTH_ORIENTATION_FILE).write_bytes(
        build_earth_orientation(start_ns - _MARGIN_NS, stop_ns + _MARGIN_NS, finals)
    )
    for kind, image in function_tables(loaded).items():
        (folder / f"{kind}.tbl").write_bytes(image)
    navigation, orientation = app.load_tables(folder, None, flight.allow_saturating)
    if int(navigation.values["filter_model"][0]) == FLIGHT:
        forces, gravity_field = build_force_tables(
            start_ns, loaded.scenario.truth.fixed_f107, space_weather_file(loaded)
        )
        (folder / app.FORCES_FILE).write_bytes(forces)
        (folder / app.GRAVITY_FIELD_FILE).write_bytes(gravity_field)
    return navigation, orientation, app.load_force_tables(folder, navigation)


def function_tables(loaded: LoadedScenario) -> dict[str, bytes]:
    """Images, by kind, of the functions beside navigation that the scenario flies."""
    flight, link = loaded.scenario.flight, loaded.scenario.crosslink
    changes = {kind: dict(table) for kind, table in flight.function_table.items()}
    if link is not None:  # what the constellation is, its satellite knows
        who = {"satellites": link.satellites, "own": link.own - 1, "two_way": int(link.two_way), "both": int(link.both)}
        changes["crosslink"] = {**who, "epoch_s": link.period_s, **changes.get("crosslink", {})}
    return {kind: build_function(kind, name, changes.get(kind)) for kind, name in flight.functions.items()}


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """Take what lives now out of the collector's sight for a while, as flight does: a pass over it takes 0.1 s."""
    mine = gc.get_freeze_count() == 0  # what somebody else has frozen stays so
    gc.collect()
    if mine:
        gc.freeze()
    try:
        yield
    finally:
        if mine:
            gc.unfreeze()


def _fly(
    world: World, loop: MainLoop, pair: VirtualBusPair, monitor: Monitor, clock: LockstepClock, report: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Tick world and flight to the end of the scenario; returns time and value of flight's dA, every ten seconds."""
    every = max(1, _ESTIMATE_STEP_S * 1_000_000_000 // loop.period_ns)
    rows = -(-world.n_ticks // every)
    t_gps_ns = np.zeros(rows, np.int64)
    da_mps2 = np.full((rows, 3), np.nan)
    at = loop.out_reader.at
    place = at["da_gcrf_mps2"]
    for k in range(world.n_ticks):
        counter_ns = world.counter_ns(k)
        clock.wait_until(counter_ns)
        world.send_due(k, pair.world, (world.start_unix_ns + k * loop.period_ns) * 1e-9)
        loop.run_tick()
        loop.rest(counter_ns + loop.period_ns)
        monitor.drain(pair.world)
        if k % every == 0:
            t_gps_ns[k // every] = loop.out[at["t_gps_ns"]]
            da_mps2[k // every] = loop.out[place : place + 3]
        if k % _PROGRESS_TICKS == 0:
            report(k)
    return t_gps_ns, da_mps2


def _summarise(
    loaded: LoadedScenario,
    world: World,
    loop: MainLoop,
    monitor: Monitor,
    navigation: TableImage,
    wall_s: float,
    out_dir: Path,
) -> dict[str, Any]:
    simulated_s = world.n_ticks * loop.period_ns * 1e-9
    counts = loop.rejected_by_cause()
    summary: dict[str, Any] = {
        "scenario": loaded.scenario.name,
        "seed": loaded.scenario.seed,
        "simulated_s": simulated_s,
        "wall_s": round(wall_s, 3),
        "realtime_factor": round(simulated_s / wall_s, 1),
        "ticks": loop.tick,
        "slips": loop.slips,
        **evaluate_run(out_dir),
        "bus": {
            "sent": world.frames_sent,
            "accepted": loop.receiver.accepted,
            "rejected": loop.rejections(),
            "published": loop.port.sent,
            "published_intact": monitor.received - monitor.bad_frames - monitor.other_frames,
        },
        "mavlink": {"messages": loop.link.messages, "alerts": loop.events.sequence},
        "rejected_by_cause": {cause.name: counts[cause] for cause in RejectCause if counts[cause]},
        "journal_dropped": loop.journal.dropped,
        "events": [
            {"sequence": int(e["sequence"]), "alert": AlertId(int(e["alert_id"])).name, "active": bool(e["active"])}
            for e in loop.events.newest_first()[::-1]
        ],
        "tables": {
            "set": navigation.set_name,
            "crc32": navigation.crc32,
            "certificate": Certificate(loop.certificate).name,
            "saturation": saturation(navigation.values) if loaded.scenario.flight.allow_saturating else [],
        },
    }
    links = crosslink_evaluation.evaluate_run(out_dir)
    if links is not None:
        summary["crosslinks"] = links
    satellites = pseudorange_evaluation.evaluate_run(out_dir)
    if satellites is not None:
        summary["pseudoranges"] = satellites
    summary["verdict"] = render_verdict(summary).splitlines()
    return summary


def _provenance(
    loaded: LoadedScenario,
    navigation: TableImage,
    orientation: TableImage,
    forces: app.ForceTables | None,
    functions: tuple[TableImage, ...],
) -> dict[str, Any]:
    """What flew, and in which world: enough to repeat the run, and to say whether a replay may give the same bytes."""
    allowed = loaded.scenario.flight.allow_saturating
    flight = identity(navigation, orientation, *(forces or ()), *functions, allow_saturating=allowed)
    return {
        "scenario": loaded.scenario.name,
        "seed": loaded.scenario.seed,
        "scenario_keys": {key: str(origin) for key, origin in sorted(loaded.origin.items())},
        "lockstep": True,
        **flight,
        "versions": {
            **flight["versions"],
            "leonav": metadata.version("leonav"),
            **{name: metadata.version(name) for name in _LIBRARIES},
        },
    }


def _timing(loop: MainLoop, wall_s: float, clock: LockstepClock, process: dict[str, Any]) -> dict[str, Any]:
    return {
        "lockstep": True,
        "wall_s": wall_s,
        "slips": loop.slips,
        "pace_missed_ticks": clock.missed if isinstance(clock, PacedClock) else None,
        "ticks": loop.tick,
        "process": process,
        "members": loop.schedule.summary(),
    }


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description:<28}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
