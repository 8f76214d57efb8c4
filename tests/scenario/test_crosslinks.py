"""One of 24 satellites with crosslinks: from ranges on the bus to the word on the operator's screen."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness import NS, Flight, Telemetry, fault, faults, frame, load, save_run

from flightsw import replay
from flightsw.crosslink.monitor import monitor_epoch
from flightsw.crosslink.setup import MonitorMemory, Settings
from flightsw.icd.alerts import AlertId
from flightsw.icd.can_frames import CROSSLINK_EPHEMERIS, CROSSLINK_RANGES, CROSSLINK_STATUS
from flightsw.icd.enums import CrosslinkMajority, CrosslinkState
from ground.console.crosslink_page import crosslink_page
from ground.console.model import State, reduce

OWN, OTHER = 1, 9  # numbers from 1
JUMPS = (
    f"crosslink_fault=[{{satellites=[{OTHER}], start_s=10.0, duration_s=8.0, jump_m=[0.0, 70.0, 0.0, 0.0]}},"
    f"{{satellites=[{OWN}], start_s=58.0, duration_s=12.0, jump_m=[70.0, 0.0, 0.0, 0.0]}}]"
)
HEALTHY = "crosslink_fault=[]"


class Flown:
    """A flight with its messages, and its frames of status with the tick of each."""

    def __init__(self, *settings: str, name: str = "crosslink_jump", folder: Path | None = None) -> None:
        self.sink = Telemetry()
        with Flight(load(*settings, name=name), folder, sink=self.sink) as flight:
            self.flight = flight.fly()
        self.status = [
            (tick, np.frombuffer(payload, CROSSLINK_STATUS.dtype)[0])
            for tick, frame_id, payload in flight.published
            if frame_id == CROSSLINK_STATUS.frame_id
        ]

    def alerts(self, alert: AlertId) -> list[tuple[float, int]]:
        """Age of the scenario [s] at each LEONAV_ALERT of a kind, and whether it began."""
        start = self.flight.world.t_start_gps_ns
        told = [m for m in self.sink.of("LEONAV_ALERT") if m.alert_id == alert]
        return [((m.t_gps_ns - start) / NS, m.active) for m in told]

    def values(self, alert: AlertId) -> list[float]:
        """What went with each LEONAV_ALERT of a kind that began."""
        return [m.value for m in self.sink.of("LEONAV_ALERT") if m.alert_id == alert and m.active]

    def at(self, second: float) -> np.void:
        """The last status frame before this age of the scenario."""
        return next(record for tick, record in reversed(self.status) if tick / 10.0 < second)


@cache
def jumps(folder: Path) -> Flown:
    """Both jumps, flown once, with logs."""
    return Flown("time.duration_s=72", JUMPS, folder=folder)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    folder = tmp_path_factory.getbasetemp() / "crosslink_jumps"
    folder.mkdir(exist_ok=True)
    return jumps(folder)


def test_a_neighbours_jump_is_named_within_two_seconds_and_over_when_it_agrees_again(flown: Flown) -> None:
    """GIVEN 24 healthy satellites WHEN the message of number 9 jumps by 70 m along its track at 10 s THEN within 2 s
    flight raises CROSSLINK_NEIGHBOUR_FAULTY and names exactly it, not itself; the fault is over at 18 s, and it is
    taken in again after 30 epochs in a row that agree.
    """
    (raised_s, began), (over_s, ended) = flown.alerts(AlertId.CROSSLINK_NEIGHBOUR_FAULTY)
    assert (began, ended) == (1, 0)
    assert 10.0 < raised_s <= 12.0
    assert 47.0 <= over_s <= 52.0
    assert flown.values(AlertId.CROSSLINK_NEIGHBOUR_FAULTY) == [OTHER]
    during = flown.at(16.0)
    assert int(during["faulty"]) == 1 << (OTHER - 1)
    assert during["own_state"] == CrosslinkState.CLEAR
    assert int(flown.at(9.0)["faulty"]) == int(flown.at(57.0)["faulty"]) == 0
    assert int(flown.status[0][1]["t_gps_ns"]) == flown.flight.world.t_start_gps_ns


def test_nothing_is_told_of_an_epoch_before_it_is_known_who_is_faulty(flown: Flown) -> None:
    """GIVEN the jump of number 9 from 10 to 18 s, its epochs weighed in one tick and searched in the next WHEN they are
    told THEN each once, with number 9 excluded, and with the statistic of those who are left: within what healthy
    satellites may have, where the search has not just named somebody."""
    start_gps_ns = flown.flight.world.t_start_gps_ns
    told = [record for _, record in flown.status if 10 < (int(record["t_gps_ns"]) - start_gps_ns) / 1e9 < 18]
    assert len(told) == 7
    for record in told:
        assert int(record["faulty"]) == 1 << (OTHER - 1)
        assert int(record["named"]) or 0.0 < float(record["network_statistic"]) < float(record["network_threshold"])


def test_the_own_jump_is_a_critical_alert_within_two_seconds(flown: Flown) -> None:
    """GIVEN the own message jumps by 70 m radially at 58 s, where no majority of links shows it, THEN within 2 s
    CROSSLINK_OWN_FAULT is raised; majority rule and neighbours stay quiet; the frame says FAULT."""
    ((raised_s, began), *_) = flown.alerts(AlertId.CROSSLINK_OWN_FAULT)
    assert began == 1
    assert 58.0 < raised_s <= 60.0
    assert flown.values(AlertId.CROSSLINK_OWN_FAULT)[0] > 1.0  # statistic over its threshold
    told = flown.at(64.0)
    assert told["own_state"] == CrosslinkState.FAULT
    assert told["majority"] == CrosslinkMajority.RELIABLE
    assert int(told["faulty"]) in (0, 1 << (OWN - 1))
    assert flown.alerts(AlertId.CROSSLINK_MAJORITY) == []
    severities = {m.severity for m in flown.sink.of("LEONAV_ALERT") if m.alert_id == AlertId.CROSSLINK_OWN_FAULT}
    assert severities == {2}


def test_every_epoch_is_judged_once_and_the_verdict_tells_the_hidden_dimension(flown: Flown) -> None:
    """GIVEN an epoch a second THEN each has one frame, in time order; with 228 links the rank is 89 of 96."""
    times = [int(record["t_gps_ns"]) for _, record in flown.status]
    start = flown.flight.world.t_start_gps_ns
    assert times == [start + k * NS for k in range(72)]
    assert all(tick / 10.0 - k < 1.0 for k, (tick, _) in enumerate(flown.status))
    record = flown.at(55.0)
    assert (int(record["rank"]), int(record["parameters"])) == (89, 96)
    assert int(record["links"]) > 200
    assert set(flown.flight.counts) <= {"CLOCK_UNSET"}


def test_the_replay_says_the_same_bytes(flown: Flown, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.getbasetemp() / "crosslink_jumps"
    save_run(flown.flight, folder)
    assert replay.replay(folder, folder / "again") == (720, None, None)


def test_the_console_shows_who_it_is(flown: Flown) -> None:
    """GIVEN the messages of the run WHEN the console folds them up to 16 s THEN its page names satellite 9, and the
    alarm stands; at the end the own message is no longer wrong for it than flight says."""
    start_s, words = flown.flight.world.start_unix_ns * 1e-9, {}
    state = State()
    for message in flown.sink:
        if message.get_type() == "LEONAV_CROSSLINK":
            t_s = (message.t_gps_ns - flown.flight.world.t_start_gps_ns) / NS
            words[round(t_s)] = crosslink_page(reduce(state, _of_flight(message), start_s + t_s), start_s + t_s).plain
        state = reduce(state, _of_flight(message), start_s)
    assert "excluded      satellite 9\n" in words[14]
    assert "own message   CLEAR" in words[14]
    assert "own message   WRONG: DO NOT USE" in words[64]
    assert "rank 89 of 96" in words[64]
    assert {alarm.alert_id for alarm in state.alarms} >= {35, 37}


def _of_flight(message: Any) -> Any:
    message._header.srcSystem = message._header.srcComponent = 1
    return message


def _beside(flight: Flight) -> list[int]:
    """Satellites that a monitor excludes, by epoch, fed straight from the world's frames: no assembly, no loop."""
    memory = MonitorMemory(Settings(both=True))
    said, epochs = {}, {}
    for k in range(flight.world.n_ticks):
        for frame_id, payload in flight.world.frames_due(k):
            if frame_id == CROSSLINK_EPHEMERIS.frame_id:
                record = np.frombuffer(payload, CROSSLINK_EPHEMERIS.dtype)[0]
                said[int(record["t_ref_gps_ns"]), int(record["satellite"])] = record
            elif frame_id == CROSSLINK_RANGES.frame_id:
                record = np.frombuffer(payload, CROSSLINK_RANGES.dtype)[0]
                epochs.setdefault(int(record["t_gps_ns"]), []).append(record)
    faulty = []
    for t_ns, frames in sorted(epochs.items()):
        links = [
            (int(f["receiver"]), int(f[f"sender_{k}"]), float(f[f"range_{k}_m"]))
            for f in frames
            for k in range(1, 6)
            if f[f"sender_{k}"] != 255
        ]
        if len(links) != int(frames[0]["links_total"]):
            continue  # of the last second
        epoch = memory.epoch[0]
        for s in range(24):
            record = said[t_ns, s]
            epoch["r_m"][s] = [record[f"{axis}_gcrf_m"] for axis in "xyz"]
            epoch["v_mps"][s] = [record[f"v{axis}_gcrf_mps"] for axis in "xyz"]
            epoch["clock_m"][s], epoch["known"][s], epoch["issue"][s] = record["clock_m"], 1, record["issue"]
        epoch["links"], epoch["t_gps_ns"] = len(links), t_ns
        for place, (receiver, sender, range_m) in enumerate(links):
            epoch["receiver"][place], epoch["sender"][place], epoch["range_m"][place] = receiver, sender, range_m
        monitor_epoch(*memory.arguments())
        faulty.append(int(memory.verdict["faulty"][0]))
    return faulty


@pytest.mark.slow
def test_a_ramp_is_told_within_two_seconds_of_the_epoch_that_shows_it() -> None:
    """GIVEN the message of number 17 grows wrong by 5 cm/s along its track from 60 s WHEN the monitor, fed beside the
    loop with the same frames, first excludes it THEN flight's alert is out within 2 s of that epoch, its last word on
    every epoch is that of the monitor beside it, and it took no more than 160 s; nobody else is ever named. An epoch
    has a second frame only where the search for slow faults has found something after the first one."""
    ramp = "crosslink_fault=[{satellites=[17], start_s=60.0, ramp_mps=[0.0, 0.05, 0.0, 0.0]}]"
    flown = Flown("time.duration_s=230", ramp, name="crosslink_ramp")
    beside = _beside(flown.flight)
    last_word = {int(record["t_gps_ns"]): int(record["faulty"]) for _, record in flown.status}
    assert list(last_word.values()) == beside[: len(last_word)]
    assert len(last_word) == 230
    assert len(flown.status) <= 230 + 2
    seen_s = next(k for k, mask in enumerate(beside) if mask)
    assert set(beside) == {0, 1 << 16}
    ((raised_s, _), *_) = flown.alerts(AlertId.CROSSLINK_NEIGHBOUR_FAULTY)
    assert 0.0 < raised_s - seen_s <= 2.0
    assert 60.0 < seen_s <= 60.0 + 160.0


def test_epochs_that_outrun_their_steps_are_judged_all_the_same() -> None:
    """GIVEN two ticks a second, fewer than an epoch has steps, WHEN satellite 9 jumps THEN every epoch but the last has
    its frame, and the last word on each is that of the monitor beside it, which takes all steps at once."""
    flown = Flown(
        "time.duration_s=60", JUMPS.replace("start_s=58.0", "start_s=50.0"), "flight.table.tick_period_ns=500000000"
    )
    beside = _beside(flown.flight)
    told = [record for _, record in flown.status if record["t_gps_ns"] > 0]  # not of the silence before the first
    last_word = {int(record["t_gps_ns"]): int(record["faulty"]) for record in told}
    assert len(last_word) >= len(beside) - 1 >= 58
    assert list(last_word.values()) == beside[: len(last_word)]
    assert {0, 1 << (OTHER - 1)} <= set(beside)


def test_lost_frames_cost_whole_epochs_and_silence_is_no_health() -> None:
    """GIVEN frames that are lost from 20 to 30 s, and none at all from 40 s on, THEN epochs that lack a frame are
    counted and not judged; and 2.5 s after the last verdict, within 2 s of when the next epoch should have been there,
    CROSSLINK_UNMONITORED and CROSSLINK_NEIGHBOUR_SILENT are raised, the state is NOT_JUDGED and all 24 satellites are
    told as not monitored, with a frame every second that tells the age of the last epoch.
    """
    entries = faults(fault("frame_drop", 20, 10, probability=0.02), fault("frame_drop", 40, 60))
    flown = Flown("time.duration_s=60", HEALTHY, entries)
    judged = [(int(r["t_gps_ns"]) - flown.flight.world.t_start_gps_ns) // NS for _, r in flown.status]
    lost = sorted(set(range(40)) - set(judged))
    assert lost
    assert all(20 <= second < 30 for second in lost)
    assert flown.flight.counts["INCOMPLETE_EPOCH"] >= len(lost)
    assert int(flown.status[-1][1]["incomplete"]) == len(lost)
    assert max(judged) == 39
    last = flown.at(60.0)
    assert last["own_state"] == CrosslinkState.NOT_JUDGED
    assert last["majority"] == CrosslinkMajority.NO_VERDICT
    assert float(last["epoch_age_s"]) == pytest.approx(20.0, abs=1.5)
    assert int(last["unmonitored"]) == (1 << 24) - 1
    assert flown.at(41.5)["own_state"] == CrosslinkState.CLEAR
    assert int(flown.at(41.5)["unmonitored"]) == 0
    due_s = 40.0 + min(tick / 10.0 - k for k, (tick, _) in enumerate(flown.status[:10]))
    for alert in (AlertId.CROSSLINK_UNMONITORED, AlertId.CROSSLINK_NEIGHBOUR_SILENT):
        *_, (raised_s, began) = flown.alerts(alert)
        assert began == 1
        assert 0.0 < raised_s - due_s <= 2.0
    early = [tick for tick, record in flown.status if 40.0 < tick / 10.0 < 43.0 and int(record["unmonitored"])]
    assert early[0] / 10.0 - due_s <= 2.0


def test_one_neighbour_that_falls_silent_is_told_and_the_others_stay_monitored() -> None:
    """GIVEN that satellite 5 broadcasts no message from 10 s on WHEN its last one is too old, after 5 s, and 2.5 s have
    gone by besides THEN CROSSLINK_NEIGHBOUR_SILENT is raised and it alone is not monitored; the own state stays CLEAR;
    with its message again from 20 s on the alert is over."""
    sink = Telemetry()
    told = {}
    with Flight(load("time.duration_s=25", HEALTHY, name="crosslink_jump"), sink=sink) as flight:
        while flight.k < flight.world.n_ticks:
            k = flight.k
            for frame_id, payload in flight.world.frames_due(k):
                silent = 100 <= k < 200 and frame_id == CROSSLINK_EPHEMERIS.frame_id
                if not silent or np.frombuffer(payload, CROSSLINK_EPHEMERIS.dtype)["satellite"][0] != 4:
                    flight.put(frame_id, payload)
            flight.tick(with_world=False)
        for tick, frame_id, payload in flight.published:
            if frame_id == CROSSLINK_STATUS.frame_id:
                told[tick] = np.frombuffer(payload, CROSSLINK_STATUS.dtype)[0]
    alerts = [m for m in sink.of("LEONAV_ALERT") if m.alert_id == AlertId.CROSSLINK_NEIGHBOUR_SILENT]
    times = [(m.t_gps_ns - flight.world.t_start_gps_ns) / NS for m in alerts]
    assert [m.active for m in alerts] == [1, 0]
    assert 16.0 < times[0] <= 18.0
    assert 20.0 < times[1] <= 21.0
    masks = {tick: int(record["unmonitored"]) for tick, record in told.items()}
    assert {mask for tick, mask in masks.items() if 10 < tick < 160 or tick > 210} == {0}
    assert {mask for tick, mask in masks.items() if 182 < tick < 200} == {1 << 4}
    assert all(record["own_state"] == CrosslinkState.CLEAR for tick, record in told.items() if tick > 10)
    assert not [m for m in sink.of("LEONAV_ALERT") if m.alert_id == AlertId.CROSSLINK_UNMONITORED]


def test_after_a_gap_the_search_for_slow_faults_begins_anew() -> None:
    """GIVEN ten seconds without a frame, more than the table's five, THEN epochs are judged again, nobody is named, and
    no block of the history from before the gap is used any more; a short gap leaves the history as it is."""
    quiet = ("time.duration_s=40", HEALTHY, "crosslink.upload_s=86400")
    gap, short = (Flown(*quiet, faults(fault("frame_drop", 15, s))) for s in (10, 2))
    for flown, since in ((gap, 2), (short, 0)):
        (function,) = flown.flight.loop._functions
        history = function.memory.history  # type: ignore[attr-defined]
        assert history["since"][0, :24].tolist() == [since] * 24
        assert not any(int(record["faulty"]) for _, record in flown.status)
        assert flown.at(40.0)["own_state"] == CrosslinkState.CLEAR


def test_the_own_satellite_alone_without_exchange() -> None:
    """GIVEN that nobody tells what he measured WHEN the own message jumps by 70 m THEN its own links show it within
    2 s, and the network is said not to be judged."""
    alone = f"crosslink_fault=[{{satellites=[{OWN}], start_s=15.0, jump_m=[0.0, 0.0, 70.0, 0.0]}}]"
    flown = Flown("time.duration_s=25", "crosslink.exchange=false", alone)
    ((raised_s, _),) = flown.alerts(AlertId.CROSSLINK_OWN_FAULT)
    assert 15.0 < raised_s <= 17.0
    last = flown.at(25.0)
    assert float(last["network_statistic"]) < 0.0
    assert int(last["faulty"]) == 0
    assert int(last["links"]) == int(last["own_links"]) > 5
    assert int(last["unmonitored"]) == (1 << 24) - 1 & ~(1 << (OWN - 1))
    assert flown.alerts(AlertId.CROSSLINK_NEIGHBOUR_SILENT) == []  # it never was monitored


def test_garbage_under_the_crosslinks_identifiers_is_counted_and_harms_nothing() -> None:
    """GIVEN frames with right CRCs and absurd content between the good ones THEN they are counted, every whole epoch
    is judged as without them, and nothing is alerted."""
    sink = Telemetry()
    with Flight(load("time.duration_s=12", HEALTHY, name="crosslink_jump"), sink=sink) as flight:
        start = flight.world.t_start_gps_ns
        while flight.k < flight.world.n_ticks:
            k = flight.k
            if k % 10 == 8:  # between two epochs
                flight.put(352, frame(352, k, t_ref_gps_ns=start, satellite=3, x_gcrf_m=float("nan")))
                flight.put(353, frame(353, k, t_gps_ns=start + (k // 10 - 4) * NS, links_total=3, sigma_m=1.0))
                flight.put(353, frame(353, k + 1, t_gps_ns=2**62, links_total=1, sigma_m=1.0, sender_1=1))
            flight.tick()
    told = {m.alert_id for m in sink.of("LEONAV_ALERT")}
    assert not told & {35, 36, 37, 38, 44, 45}
    assert flight.counts["NOT_FINITE"] >= 10
    assert flight.counts["TIME_STALE"] >= 4
