"""`ground accuracy`: the filter and the force model against real orbits, the integrators against each other."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ground.accuracy.bench_command import add_bench, run_bench
from ground.errors import OperatorError

if TYPE_CHECKING:
    from ground.accuracy.flight_model import FlightModel
    from ground.accuracy.orbits import ReferenceOrbit

HELP = "measure the flight models against real orbits, and what they cost"
# file below the data folder -> the satellite's cross-section by mass [m2/kg], from public figures: GRACE-FO 600 kg and
# 1.0 m2 (frontal), Sentinel-3 1150 kg, Sentinel-1 2200 kg, Jason-2 510 kg, with their solar arrays
ORBITS = {
    "leo_sp3/ssas3a20.b18358.e19003.DG_.sp3.gz": 0.005,
    "leo_gracefo/GRACE-C_59412_orbit_crf.orb.gz": 0.0018,
    "leo_sp3/grgja203.b08243.e08247.D_S.sp3.gz": 0.02,
    "leo_sentinel1a/S1A_OPER_AUX_RESORB_OPOD_20230823T162050_V20230823T123139_20230823T154909.EOF.gz": 0.01,
}
GRAVITY = "gravity/EGM2008_120.gfc.gz"


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground accuracy`."""
    parser = subparsers.add_parser("accuracy", help=HELP, description=HELP)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    forces = actions.add_parser("forces", help="the force model alone, from published states, beside satkit")
    integrators = actions.add_parser("integrators", help="error and cost of each integrator by its step")
    for action in (forces, integrators):
        action.add_argument(
            "--orbit", metavar="FILE", type=Path, action="append", help=".sp3, .orb, .EOF (also .gz); may be repeated"
        )
        action.add_argument(
            "--gravity", metavar="FILE", type=Path, help="ICGEM file (default: EGM2008, else the packaged one)"
        )
        action.add_argument("--degree", metavar="N", type=int, default=70, help="degree and order (default 70)")
        action.add_argument(
            "--set", dest="settings", metavar="KEY=VALUE", action="append", default=[], help="field of the force table"
        )
    forces.add_argument("--starts", metavar="N", type=int, help="at most so many starts (default: all, 1000 s apart)")
    forces.add_argument("--peer-starts", metavar="N", type=int, default=20, help="starts flown by satkit (0: none)")
    add_bench(actions)
    step = actions.add_parser("step", help="time of the filter's step by degree, beside satkit's propagation")
    step.add_argument("--degree", metavar="N", type=int, action="append", help="degree and order; may be repeated")
    step.add_argument("--gravity", metavar="FILE", type=Path, help="ICGEM file (default: EGM2008, else the packaged)")


def run(args: argparse.Namespace) -> int:
    """Measure and print; returns 0."""
    data = data_folder()
    if args.action == "bench":
        return run_bench(args, data, args.gravity or gravity_of(data))
    if args.action == "step":
        return _run_step(args, args.gravity or gravity_of(data))
    from ground.accuracy.orbits import read_orbit
    from ground.tables.build import parse_setting

    files = args.orbit or [data / name for name in ORBITS if (data / name).is_file()]
    if not files:
        raise OperatorError(f"no real orbits at {data}: set LEONAV_DATA to their folder or name files with --orbit")
    gravity = args.gravity or gravity_of(data)
    asked = {"degree": args.degree, **dict(parse_setting(text) for text in args.settings)}
    for path in files:
        settings = {"area_to_mass_m2pkg": _area_to_mass(path), **asked}
        orbit = read_orbit(path)
        model = _model(orbit, gravity, settings)
        print(f"{orbit.name}: {model.gravity_name}, flown to degree {int(model.forces['degree'][0])}", flush=True)
        if args.action == "forces":
            _print_forces(model, orbit, args.starts, args.peer_starts)
        else:
            _print_integrators(model, orbit)
        print()
    return 0


def _run_step(args: argparse.Namespace, gravity: Path | None) -> int:
    from ground.accuracy import step_cost

    for degree in args.degree or ():
        if not 2 <= degree <= 120:
            raise OperatorError(f"--degree {degree}: give 2 to 120")
    print(step_cost.table(step_cost.measure(tuple(args.degree or step_cost.DEGREES), gravity)))
    return 0


def data_folder() -> Path:
    """Folder of real orbits and gravity fields: LEONAV_DATA, else beside the repository."""
    named = os.environ.get("LEONAV_DATA")
    return Path(named) if named else Path(__file__).resolve().parents[3] / "shared" / "data"


def gravity_of(data: Path) -> Path | None:
    """EGM2008 of the data folder; None, the packaged field, where it is not there."""
    return data / GRAVITY if (data / GRAVITY).is_file() else None


def _area_to_mass(path: Path) -> float:
    return next((value for name, value in ORBITS.items() if Path(name).name == path.name), 0.005)


def _model(orbit: ReferenceOrbit, gravity: Path | None, settings: dict[str, Any]) -> FlightModel:
    """The model with the space weather of the middle of the orbit."""
    from ground.accuracy.flight_model import FlightModel
    from ground.tables.gps_time import day_of_gps

    middle = int(orbit.t_gps_ns[len(orbit.t_gps_ns) // 2])
    return FlightModel(orbit.orientation, gravity, settings, day_of_gps(middle))


def _print_forces(model: FlightModel, orbit: ReferenceOrbit, at_most: int | None, peer_starts: int) -> None:
    import numpy as np

    from ground.accuracy import forces

    print(f"  {'':8}{'after':>8}{'starts':>8}{'median m':>11}{'max m':>11}{'ms each':>10}")
    settings = {name: model.forces[name][0] for name in model.forces.dtype.names or ()}
    for age_s in forces.AGES_S:
        try:
            found, spent_ms = forces.flight_errors(model, orbit, age_s, at_most)
            rows = [(found, spent_ms)]
            if peer_starts:
                rows.append(forces.satkit_errors(orbit, settings, int(settings["degree"]), age_s, peer_starts))
        except OperatorError as error:
            print(f"  {error}")
            continue
        for errors, spent in rows:
            print(
                f"  {errors.who:8}{age_s:>6} s{len(errors.error_m):>8}{np.median(errors.error_m):>11.3f}"
                f"{errors.error_m.max():>11.3f}{spent:>10.2f}",
                flush=True,
            )
    costs = forces.costs_us(model, int(orbit.t_gps_ns[0]), orbit.x[0])
    print("  cost [us]: " + ", ".join(f"{name} {value:.2f}" for name, value in costs.items()))
    step_us = costs["Sun, Moon, tide (once a step)"] + 4 * costs["Earth rotation"] + 4 * costs["forces, all"]
    print(f"  one step of the state, 4 evaluations: {step_us:.1f} us")


def _print_integrators(model: FlightModel, orbit: ReferenceOrbit) -> None:
    from ground.accuracy import forces, integrators

    chosen = forces.starts(orbit, 1800, 6)
    print(f"  {'':12}{'step s':>8}{'max error m':>14}{'evaluations/h':>16}{'ms/h':>9}   ({len(chosen)} starts, 1800 s)")
    for row in integrators.measure(model, [(int(orbit.t_gps_ns[k]), orbit.x[k]) for k in chosen]):
        print(
            f"  {row.name:12}{row.step_s:>8}{row.error_m:>14.2e}{row.evaluations_per_hour:>16}"
            f"{row.us_per_hour / 1e3:>9.2f}"
        )
