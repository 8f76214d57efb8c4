"""How much faster than real time a run is, member by member. A bench shows, it asserts nothing.

python tests/timing/bench_realtime.py [SCENARIO] [--set KEY=VALUE ...]
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from harness import Flight

from hil_sim import scenario


def main() -> None:
    """Fly the scenario with journal and bus, print percentiles."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scenario", nargs="?", default="two_orbits")
    parser.add_argument("--set", action="append", default=[])
    options = parser.parse_args()
    loaded = scenario.load(options.scenario, options.set)
    with tempfile.TemporaryDirectory() as folder, Flight(loaded, Path(folder)) as flight:
        world, loop, clock, pair = flight.world, flight.loop, flight.clock, flight.pair
        started = time.perf_counter()
        for k in range(world.n_ticks):
            counter_ns = world.counter_ns(k)
            clock.wait_until(counter_ns)
            world.send_due(k, pair.world, 0.0)
            loop.run_tick()
            loop.rest(counter_ns + flight.period_ns)
            while pair.world.recv(0.0) is not None:
                pass
        wall_s = time.perf_counter() - started
    simulated_s = world.n_ticks * flight.period_ns * 1e-9
    load = ", ".join(f"{one:.2f}" for one in os.getloadavg())
    print(f"{options.scenario}: {world.n_ticks} ticks, {simulated_s:.0f} s in {wall_s:.2f} s wall")
    print(f"{simulated_s / wall_s:.0f} times real time; load of the machine {load} on {os.cpu_count()} cores")
    print(
        f"{'member':<20}{'runs':>9}{'mean us':>10}{'p50':>9}{'p99':>9}{'p99.9':>9}{'max':>10}{'budget':>9}{'over':>7}"
    )
    for name, member in loop.schedule.summary().items():
        if member["runs"]:
            figures = [member[key] for key in ("mean_us", "p50_us", "p99_us", "p99.9_us", "max_us", "budget_us")]
            row = f"{figures[0]:10.1f}" + "".join(f"{one:9.1f}" for one in figures[1:4])
            print(f"{name:<20}{member['runs']:9}{row}{figures[4]:10.1f}{figures[5]:9.0f}{member['over_budget']:7}")


if __name__ == "__main__":
    main()
