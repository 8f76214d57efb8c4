"""Truth propagated by satkit: interpolation, elements, atmosphere, and that bad data cannot pass silently."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import numpy as np
import pytest

from hil_sim import gps_time, scenario
from hil_sim.errors import DataError
from hil_sim.scenario_schema import Orbit, TruthModel
from hil_sim.truth import propagated
from hil_sim.truth.earth_rotation import packaged_finals
from hil_sim.truth.satkit_data import fixed_space_weather, satkit_time, session

T0_NS = scenario.load("two_orbits").t_start_gps_ns
ORBIT_500_KM = Orbit(semi_major_axis_m=6_878_136.3, eccentricity=0.0005, inclination_deg=65.0)
MU_M3PS2 = 3.986004415e14
SECONDS = gps_time.NS


@pytest.fixture(scope="module")
def truth():
    return propagated.propagate(ORBIT_500_KM, TruthModel(), T0_NS, 6000 * SECONDS)


def test_interpolation_below_a_millimetre(truth) -> None:
    """Nodes lie 10 s apart; the oracle propagates to the very instant without any interpolation."""
    model = TruthModel()
    with session(T0_NS, T0_NS + 6000 * SECONDS) as satkit:
        settings, satellite = propagated._settings(satkit, model)
        for seconds in (4.999, 5.0, 1234.567, 3333.3, 5994.9):
            direct = satkit.propagate(
                propagated.initial_state(ORBIT_500_KM),
                satkit_time(satkit, T0_NS),
                duration_secs=seconds,
                propsettings=settings,
                satproperties=satellite,
            )
            r, v = truth.state_gcrf(np.array([T0_NS + round(seconds * 1e9)]))
            assert np.abs(r[0] - direct.pos).max() < 1e-3
            assert np.abs(v[0] - direct.vel).max() < 1e-6


@pytest.mark.parametrize("argument_of_latitude_deg", [0.0, 44.0, 44.6, 44.8, 164.7, 165.3])
def test_the_first_half_minute_moves_as_it_says(argument_of_latitude_deg: float) -> None:
    """GIVEN starts in the open and right after the edge of the Earth's shadow, where the integrator takes many steps
    back to the nodes before the start WHEN position is differentiated THEN it is the velocity: no node is wrong."""
    orbit = msgspec.structs.replace(ORBIT_500_KM, argument_of_latitude_deg=argument_of_latitude_deg)
    truth = propagated.propagate(orbit, TruthModel(), T0_NS, 60 * SECONDS)
    middle_ns = T0_NS + np.arange(1, 31) * SECONDS
    _, v = truth.state_gcrf(middle_ns)
    # five points half a second apart: their own error is h^4/30 of the fifth derivative, some 2e-11 m/s, and digits
    r = [truth.state_gcrf(middle_ns + k * SECONDS // 2)[0] for k in (-2, -1, 1, 2)]
    assert np.abs((r[0] - 8.0 * r[1] + 8.0 * r[2] - r[3]) / 6.0 - v).max() < 1e-7


def test_start_has_the_elements_of_the_scenario() -> None:
    """Checked by vis-viva, the angular momentum and the eccentricity vector, not by the code's own formulae."""
    orbit = Orbit(
        period_s=5580.0,
        eccentricity=0.01,
        inclination_deg=65.0,
        raan_deg=40.0,
        argument_of_perigee_deg=20.0,
        argument_of_latitude_deg=100.0,
    )
    state = propagated.initial_state(orbit)
    r, v = state[:3], state[3:]
    a = 1.0 / (2.0 / np.linalg.norm(r) - v @ v / MU_M3PS2)
    h = np.cross(r, v)
    node = np.cross([0.0, 0.0, 1.0], h)
    e = np.cross(v, h) / MU_M3PS2 - r / np.linalg.norm(r)
    angle = lambda x, y: np.degrees(np.arccos(x @ y / np.linalg.norm(x) / np.linalg.norm(y)))  # noqa: E731
    assert 2.0 * np.pi * np.sqrt(a**3 / MU_M3PS2) == pytest.approx(5580.0, abs=1e-6)
    assert np.linalg.norm(e) == pytest.approx(0.01, abs=1e-12)
    assert np.degrees(np.arccos(h[2] / np.linalg.norm(h))) == pytest.approx(65.0, abs=1e-9)
    assert np.degrees(np.arctan2(node[1], node[0])) == pytest.approx(40.0, abs=1e-9)
    assert angle(node, e) == pytest.approx(20.0, abs=1e-6)
    assert angle(node, r) == pytest.approx(100.0, abs=1e-9)


def test_residual_acceleration_is_mostly_j2(truth) -> None:
    """Against the closed J2 formula (Montenbruck and Gill 2000, eq. 3.29 and table 3.1) within the other terms."""
    t = T0_NS + np.arange(0, 5700, 10) * SECONDS
    r, _ = truth.state_gcrf(t)
    x, y, z = r.T
    radius = np.linalg.norm(r, axis=1)
    factor = -1.5 * 1.0826e-3 * MU_M3PS2 * 6_378_136.3**2 / radius**5
    pole = 5.0 * z**2 / radius**2
    j2 = factor[:, None] * np.stack((x * (1.0 - pole), y * (1.0 - pole), z * (3.0 - pole)), axis=1)
    # the sign: gravity of an oblate Earth is stronger at the equator, hence factor < 0 outward there
    difference = np.linalg.norm(truth.acceleration_residual(t) - j2, axis=1)
    assert np.linalg.norm(j2, axis=1).min() > 9e-3
    assert difference.max() < 4e-4


def test_solar_activity_drives_density_and_drag() -> None:
    """GIVEN 500 km WHEN F10.7 is 200 instead of 70 THEN orbit-mean density and orbital decay are >= 4 times larger."""
    t = T0_NS + np.linspace(0, 5676, 60).astype(np.int64) * SECONDS
    density, decay = {}, {}
    still_air = propagated.propagate(
        ORBIT_500_KM, TruthModel(solar="fixed:70", drag_coefficient=0.0), T0_NS, 20_000 * SECONDS
    )
    end = np.array([T0_NS + 20_000 * SECONDS])
    for flux in (70, 200):
        model = TruthModel(solar=f"fixed:{flux}")
        truth = propagated.propagate(ORBIT_500_KM, model, T0_NS, 20_000 * SECONDS)
        density[flux] = propagated.density_kgpm3(truth, t, model).mean()
        decay[flux] = np.linalg.norm(truth.state_gcrf(end)[0] - still_air.state_gcrf(end)[0])
    assert density[200] / density[70] >= 4.0
    assert decay[200] / decay[70] >= 4.0


def test_space_weather_is_loaded_anew_for_every_truth(truth) -> None:
    """GIVEN a run with a fixed F10.7 in the same process WHEN data is used again THEN the truth is as before."""
    propagated.propagate(ORBIT_500_KM, TruthModel(solar="fixed:250"), T0_NS, 600 * SECONDS)
    again = propagated.propagate(ORBIT_500_KM, TruthModel(), T0_NS, 6000 * SECONDS)
    t = T0_NS + np.arange(0, 6000, 100) * SECONDS
    assert np.array_equal(again.state_gcrf(t)[0], truth.state_gcrf(t)[0])


def test_threads_do_not_mix_their_space_weather() -> None:
    """satkit keeps one space-weather table a process; truths built at once come out as built one by one."""
    models = [TruthModel(solar=f"fixed:{flux}") for flux in (70, 150, 250)] * 3
    t = T0_NS + np.array([5000 * SECONDS])

    def end(model: TruthModel) -> list[float]:
        return propagated.propagate(ORBIT_500_KM, model, T0_NS, 5000 * SECONDS).state_gcrf(t)[0][0].tolist()

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(end, models)) == [end(model) for model in models]


def test_span_without_daily_space_weather_is_refused_unless_fixed() -> None:
    """GIVEN a date for which only monthly solar predictions exist THEN it is refused, and F10.7 fixed lets it pass."""
    loaded = scenario.load("two_orbits", ["time.start=2027-03-01T00:00:00"])
    orbit, start = loaded.scenario.orbit, loaded.t_start_gps_ns
    with pytest.raises(DataError, match="fixed:150"):
        propagated.propagate(orbit, TruthModel(), start, 600 * SECONDS)
    propagated.propagate(orbit, TruthModel(solar="fixed:150"), start, 600 * SECONDS)


def test_span_without_earth_orientation_is_refused() -> None:
    start = scenario.load("two_orbits", ["time.start=2035-03-01T00:00:00"]).t_start_gps_ns
    with pytest.raises(DataError, match="earth_orientation_file"):
        propagated.propagate(ORBIT_500_KM, TruthModel(solar="fixed:150"), start, 600 * SECONDS)


def test_solar_flux_must_be_possible() -> None:
    with pytest.raises(DataError, match="solar minimum"):
        fixed_space_weather(1500.0, T0_NS, T0_NS + SECONDS)


def _in_a_fresh_process(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | environment, timeout=120
    )


_ONE_SHORT_TRUTH = """
from hil_sim import scenario
from hil_sim.errors import DataError
from hil_sim.scenario_schema import Orbit, TruthModel
from hil_sim.truth import propagated
def run(finals=None):
    start = scenario.load("two_orbits").t_start_gps_ns
    try:
        truth = propagated.propagate(
            Orbit(period_s=5700.0), TruthModel(), start, 600 * 10**9, finals_path=finals)
    except DataError as error:
        print("REFUSED", error)
    else:
        print(*(float(x).hex() for x in truth.state_gcrf([start + 300 * 10**9])[0][0]))
"""


def test_zero_earth_orientation_cannot_happen(tmp_path: Path) -> None:
    """GIVEN satkit already used elsewhere without finals2000A WHEN a truth is asked for THEN it is refused."""
    code = "import satkit; satkit.frametransform.qgcrf2itrf(satkit.time(2019, 1, 1))\n" + _ONE_SHORT_TRUTH + "run()\n"
    done = _in_a_fresh_process(
        code, SATKIT_DATA=str(tmp_path), SATKIT_OFFLINE="1", HOME=str(tmp_path), XDG_DATA_HOME=str(tmp_path)
    )
    assert done.stdout.startswith("REFUSED"), done.stdout + done.stderr


def test_data_of_the_user_do_not_step_in_front(tmp_path: Path) -> None:
    """GIVEN SATKIT_DATA pointing at another, empty finals2000A.all THEN the packaged one is used all the same."""
    (tmp_path / "finals2000A.all").write_text("")
    plain = _in_a_fresh_process(_ONE_SHORT_TRUTH + "run()\n")
    disturbed = _in_a_fresh_process(_ONE_SHORT_TRUTH + "run()\n", SATKIT_DATA=str(tmp_path))
    assert plain.returncode == 0, plain.stderr
    assert plain.stdout == disturbed.stdout
    assert "REFUSED" not in plain.stdout
    assert "warning" not in plain.stderr.lower()


def test_own_earth_orientation_file(tmp_path: Path) -> None:
    """GIVEN a file with UT1 0.1 s off THEN gravity turns with it; a second file in the process is refused."""
    shifted = tmp_path / "mine.all"
    lines = []
    for line in packaged_finals().read_text().splitlines():
        value = line[58:68].strip()
        lines.append(f"{line[:58]}{float(value) + 0.1:10.7f}{line[68:]}" if value else line)
    shifted.write_text("\n".join(lines) + "\n")
    code = _ONE_SHORT_TRUTH + f"from pathlib import Path\nrun(Path({str(shifted)!r}))\nrun()\n"
    done = _in_a_fresh_process(code, XDG_CACHE_HOME=str(tmp_path / "cache"))
    first, second = done.stdout.splitlines()
    plain = _in_a_fresh_process(_ONE_SHORT_TRUTH + "run()\n").stdout
    moved = np.array([float.fromhex(x) for x in first.split()]) - [float.fromhex(x) for x in plain.split()]
    assert 1e-5 < np.linalg.norm(moved) < 1.0
    assert second.startswith("REFUSED")
    assert "start another" in second


def test_forces_of_the_model_matter(truth) -> None:
    """Each switch changes the orbit by more than numerical noise and less than its known size over 6000 s."""
    end = np.array([T0_NS + 5990 * SECONDS])
    reference = truth.state_gcrf(end)[0]
    for change, low_m, high_m in (
        ({"sun": False}, 0.1, 50.0),
        ({"moon": False}, 0.1, 100.0),
        ({"tides": False}, 0.01, 5.0),
        ({"drag_coefficient": 0.0}, 0.05, 50.0),
        ({"srp_coefficient": 0.0}, 0.05, 20.0),
        ({"gravity_degree": 20}, 1.0, 500.0),
    ):
        other = propagated.propagate(
            ORBIT_500_KM, msgspec.structs.replace(TruthModel(), **change), T0_NS, 6000 * SECONDS
        )
        assert low_m < np.linalg.norm(other.state_gcrf(end)[0] - reference) < high_m, change
