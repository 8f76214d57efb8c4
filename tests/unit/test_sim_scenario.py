"""Scenarios: what ships is valid, what is impossible is refused with file, key and remedy, origins are told."""

from pathlib import Path

import pytest

from hil_sim import scenario
from hil_sim.errors import DataError, ScenarioError

SHIPPED = (
    *("burn_in_outage", "crosslink_glonass", "crosslink_jump", "crosslink_ramp", "demo", "gnss_faults"),
    *("graceb_faults", "graceb_gaps", "graceb_pseudoranges", "graceb_real", "gracefo_outage", "j2_outage"),
    *("nominal", "paper_outage"),
    *("sentinel3a_outage", "single_frequency", "soak", "two_orbits", "unannounced_burn", "velocity_bias"),
)


def test_what_ships() -> None:
    assert tuple(scenario.shipped()) == SHIPPED
    for name in SHIPPED:
        loaded = scenario.load(name)
        assert loaded.scenario.name == name
        assert loaded.scenario.description


def test_paper_outage_is_the_papers() -> None:
    """One orbit of 5580 s, 2000 s without GNSS, 1 m and 1 m/s, the set "paper"."""
    s = scenario.load("paper_outage").scenario
    assert (s.orbit.period_s, s.outage[0].start_s, s.outage[0].duration_s) == (5580.0, 5580.0, 2000.0)
    assert (s.gnss.sigma_position_m, s.gnss.sigma_velocity_mps, s.flight.table_set) == (1.0, 1.0, "paper")
    assert s.time.duration_s - 7580.0 == 1200.0


@pytest.mark.parametrize(
    ("override", "key", "remedy"),
    [
        ("gnss.sigma_positon_m=3", "gnss.sigma_positon_m", "did you mean 'sigma_position_m'?"),
        ("gnss.sigma_position_km=0.033", "gnss.sigma_position_km", "did you mean 'sigma_position_m'?"),
        ("orbit.period_min=93", "orbit.period_min", "did you mean 'period_s'?"),
        ("gns.rate_hz=1", "gns", "did you mean 'gnss'?"),
        ("outage.0.lenght_s=5", "outage.0.lenght_s", "keys here: start_s, duration_s"),
        ('gnss.sigma_position_m="33 m"', "gnss.sigma_position_m", "a plain number in metres"),
        ("gnss.sigma_position_m=33m", "gnss.sigma_position_m", "a plain number in metres"),
        ("orbit.period_s=93", "orbit.period_s", "the Keplerian period in seconds"),
        ("orbit.semi_major_axis_m=6878", "orbit.semi_major_axis_m", "semi-major axis in metres"),
        ("orbit.inclination_deg=181", "orbit.inclination_deg", "inclination in degrees"),
        ("orbit.eccentricity=0.1", "orbit.eccentricity", "keep it above 150 km"),
        ("gnss.sigma_velocity_mps=-1", "gnss.sigma_velocity_mps", "velocity noise"),
        ("gnss.latency_s=nan", "gnss.latency_s", "seconds"),
        ("time.duration_s=inf", "time.duration_s", "seconds"),
        ("time.start=yesterday", "time.start", "2019-01-01T00:00:00"),
        ("time.start=2019-01-01T00:00:00Z", "time.start", "time.scale"),
        ("time.scale=ut1", "time.scale", "gps, utc or tai"),
        ("truth.solar=120", "truth.solar", "fixed:120"),
        ("truth.gravity_degree=71", "truth.gravity_degree", "EGM2008"),
        ("truth.sun=1", "truth.sun", "true or false"),
        ("seed=1.5", "seed", "a whole number"),
        ("seed=-1", "seed", "seed of every random stream"),
        ("gnss.rate_hz=0.3", "gnss.rate_hz", "use for example"),
        ("gnss=3", "gnss", "a table"),
        ("orbit.source=sp3", "orbit.file", "give its path"),
        ("outage.0.start_s=1e6", "outage.0.start_s", "start it earlier"),
        ("name=../up", "name", "lower-case"),
        ('fault=[{kind="nann", start_s=1}]', "fault.0.kind", "one of position_step"),
        ('fault=[{kind="position_step", start_s=1}]', "fault.0.value", "give metres"),
        ('fault=[{kind="nan", start_s=1, value=3}]', "fault.0.value", "remove it"),
        ('fault=[{kind="truncate", start_s=1, value=33}]', "fault.0.value", "CAN FD"),
        ('fault=[{kind="bit_flip", start_s=1, target="clock"}]', "fault.0.target", "one of all"),
        ('fault=[{kind="bit_flip", start_s=1, probability=2}]', "fault.0.probability", "0 to 1"),
        ('fault=[{kind="bit_flip", start_s=1, hold_time=true}]', "fault.0.hold_time", "frozen_fix"),
        ('fault=[{kind="bit_flip", start_s=1e6}]', "fault.0.start_s", "start it earlier"),
        ("burn=[{start_s=0.0, duration_s=9.0, dv_mps=[0, 1, 0]}]", "burn.0.start_s", "1 at least"),
        ("burn=[{start_s=99.0, dv_mps=[0, 1, 0]}]", "burn.0.duration_s", "how long the thrust lasts"),
        ("burn=[{start_s=99.0, duration_s=9.0, dv_mps=[0, 1]}]", "burn.0.dv_mps", "velocity change in the axes"),
        ("burn=[{start_s=99.0, duration_s=9.0, dv_mps=[0, 1e3, 0]}]", "burn.0.dv_mps.1", "velocity change in the axes"),
        ("burn=[{start_s=99.0, duration_s=9.0, dv_mps=1}]", "burn.0.dv_mps", "velocity change in the axes"),
        ('burn=[{start_s=99.0, duration_s=9.0, dv_mps=[0, 1, 0], frame="ntw"}]', "burn.0.frame", "gcrf or rtn"),
        ("burn=[{start_s=8779.0, duration_s=9.0, dv_mps=[0, 1, 0]}]", "burn.0.start_s", "lengthen time.duration_s"),
        ("burn=[{start_s=30.0, duration_s=9.0, dv_mps=[0, 1, 0]}]", "burn.0.announce_lead_s", "announced = false"),
        (
            "burn=[{start_s=99.0, duration_s=9.0, dv_mps=[0, 1, 0]}, {start_s=100, duration_s=9.0, dv_mps=[0, 1, 0]}]",
            "burn.1.start_s",
            "in order of time",
        ),
        ('command=[{at_s=1e4, command="reset_filter"}]', "command.0.at_s", "give it earlier"),
        ('command=[{at_s=1.0, command="restart"}]', "command.0.command", "edit or reset_filter"),
        (
            'command=[{at_s=1.0, command="edit", target="position"}]',
            "command.0.value",
            "auto, accept, reject or inhibit",
        ),
        ('command=[{at_s=1.0, command="reset_filter", value="auto"}]', "command.0.value", "remove it"),
        ("attitude.rate_hz=1", "attitude.sigma_rad", "white error about each body axis"),
        ("attitude={rate_hz=0.3, sigma_rad=0.1}", "attitude.rate_hz", "use for example"),
        ("attitude={sigma_deg=0.1}", "attitude.sigma_deg", "did you mean 'sigma_rad'?"),
        ("attitude=3", "attitude", "a table"),
        ("gnss.antenna_offset_m=[1, 2, 1000]", "gnss.antenna_offset_m.2", "body axes"),
        ("gnss.velocity=1", "gnss.velocity", "true or false"),
        ("gnss.claimed_sigma_m=0", "gnss.claimed_sigma_m", "sigma the receiver claims"),
        ('fault=[{kind="nan", start_s=1, target="burn"}]', "fault.0.target", "one of all, position, velocity, sync"),
        ('fault=[{kind="bit_flip", start_s=1, target="burn"}]', "fault.0.target", "add it"),
    ],
)
def test_refused_with_place_key_and_remedy(override: str, key: str, remedy: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario.load("paper_outage", [override])
    text = str(caught.value)
    assert text.startswith(("--set: ", str(scenario.SCENARIO_FOLDER / "paper_outage.toml")))
    assert f": {key}: " in text
    assert remedy in text
    assert "\n" not in text


def test_a_replayed_orbit_takes_no_burn_and_a_receiver_without_velocity_no_fault_of_it() -> None:
    burn = "burn=[{start_s=99.0, duration_s=9.0, dv_mps=[0, 1, 0]}]"
    with pytest.raises(ScenarioError, match=r"burn\.0\.start_s: a replayed orbit .*set orbit\.source = .propagated"):
        scenario.load("gracefo_outage", [burn])
    for fault in ('{kind="velocity_step", start_s=1, value=1}', '{kind="bit_flip", start_s=1, target="velocity"}'):
        with pytest.raises(ScenarioError, match=r"fault\.0\.kind: the receiver gives no velocity; set gnss\.velocity"):
            scenario.load("nominal", ["gnss.velocity=false", f"fault=[{fault}]"])


def test_components_of_a_vector_may_be_overridden() -> None:
    s = scenario.load("burn_in_outage", ["burn.0.dv_mps.1=0.5", "burn.0.sigma_mps=[0, 0, 0.1]"]).scenario
    assert s.burn[0].dv_mps == (0.0, 0.5, 0.0)
    assert s.burn[0].sigma_mps == (0.0, 0.0, 0.1)


def test_burn_in_outage_is_the_one_of_the_study() -> None:
    """500 km circular, 97.5 degrees; 1 m/s along track over 20 s, 600 s into an outage of 2000 s after an orbit of
    fixes of 10 m and 0.1 m/s; 2 % on each axis."""
    s = scenario.load("burn_in_outage").scenario
    assert (s.orbit.semi_major_axis_m, s.orbit.eccentricity, s.orbit.inclination_deg) == (6_878_137.0, 0.0, 97.5)
    assert (s.gnss.sigma_position_m, s.gnss.sigma_velocity_mps) == (10.0, 0.1)
    (outage,), (burn,) = s.outage, s.burn
    assert outage.duration_s == 2000.0
    assert burn.start_s - outage.start_s == 600.0
    assert (burn.dv_mps, burn.duration_s, burn.frame, burn.announced) == ((0.0, 1.0, 0.0), 20.0, "rtn", True)
    assert burn.sigma_mps == (0.02, 0.02, 0.02)
    silent = scenario.load("unannounced_burn").scenario.burn[0]
    assert (silent.dv_mps, silent.announced) == ((0.0, 0.05, 0.0), False)


def test_a_mistake_in_a_file_names_the_file(tmp_path: Path) -> None:
    text = (scenario.SCENARIO_FOLDER / "paper_outage.toml").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("sigma_position_m = 1.0", "sigma_positoin_m = 1.0"))
    with pytest.raises(ScenarioError) as caught:
        scenario.load(str(path))
    assert str(caught.value).startswith(f"{path}: gnss.sigma_positoin_m: unknown key; did you mean")
    path.write_text(text.replace("sigma_position_m = 1.0", ""))
    with pytest.raises(ScenarioError, match=r"gnss\.sigma_position_m: missing"):
        scenario.load(str(path))
    path.write_text("seed = = 3")
    with pytest.raises(ScenarioError, match="not TOML"):
        scenario.load(str(path))
    with pytest.raises(ScenarioError, match="no such scenario file"):
        scenario.load(str(tmp_path / "absent.toml"))


def test_unknown_scenario() -> None:
    with pytest.raises(ScenarioError, match="did you mean 'nominal'"):
        scenario.load("nomnal")


def test_overrides_of_every_shape() -> None:
    loaded = scenario.load(
        "paper_outage",
        [
            "seed=7",
            "outage.0.duration_s=600",
            "outage.1.start_s=7000",
            "outage.1.duration_s=100",
            "flight.table_set=j2",
            "flight.table.k_axis=3.5",
            "flight.table.autonomous_q_r_m2=[1.0, 2.0]",
            "orbit.semi_major_axis_m=7.0e6",
            "fault.0.kind=nan",
            "fault.0.start_s=10",
            "time.start=2019-02-03",
        ],
    )
    s = loaded.scenario
    assert (s.seed, s.flight.table_set, s.time.start) == (7, "j2", "2019-02-03")
    assert [(o.start_s, o.duration_s) for o in s.outage] == [(5580.0, 600.0), (7000.0, 100.0)]
    assert s.flight.table == {"k_axis": 3.5, "autonomous_q_r_m2": [1.0, 2.0]}
    assert s.orbit.period_s is None  # one of the two sizes replaces the other
    assert s.fault[0].kind == "nan"
    assert scenario.load("paper_outage", ["outage=[]"]).scenario.outage == ()


def test_later_overrides_win() -> None:
    assert scenario.load("nominal", ["seed=2", "seed=3"]).scenario.seed == 3


@pytest.mark.parametrize(
    "text", ["seed", "=3", "gnss..rate_hz=1", "outage.x.start_s=1", "outage.5.start_s=1", "seed.x=1"]
)
def test_malformed_overrides(text: str) -> None:
    with pytest.raises(ScenarioError, match="--set"):
        scenario.load("paper_outage", [text])


def test_origin_of_every_key() -> None:
    loaded = scenario.load("paper_outage", ["gnss.sigma_position_m=33", "outage.0.duration_s=600"])
    assert loaded.origin["gnss.sigma_position_m"] == "--set"
    assert loaded.origin["gnss.sigma_velocity_mps"] == "file"
    assert loaded.origin["gnss.rate_hz"] == "default"
    assert loaded.origin["outage.0.start_s"] == "file"
    assert loaded.origin["outage.0.duration_s"] == "--set"
    shown = {line.split()[0]: line.split()[-1] for line in scenario.describe(loaded).splitlines()[1:]}
    assert shown == loaded.origin | {"name": "file"}


def test_start_in_three_time_scales() -> None:
    start = {k: scenario.load("two_orbits", [f"time.scale={k}"]).t_start_gps_ns for k in ("gps", "utc", "tai")}
    assert start["utc"] - start["gps"] == 18_000_000_000
    assert start["tai"] - start["gps"] == -19_000_000_000


def test_absent_data_name_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN no real data on this machine WHEN a replay is asked for THEN variable and override are named."""
    monkeypatch.setenv(scenario.DATA_VARIABLE, str(tmp_path))
    loaded = scenario.load("gracefo_outage")
    assert loaded.scenario.orbit.file is not None
    with pytest.raises(DataError, match=r"orbit\.file: no file .*LEONAV_DATA.*--set orbit\.file="):
        scenario.resolve_data_file(loaded.scenario.orbit.file, loaded.path, "orbit.file")
