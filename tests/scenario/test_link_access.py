"""Orders that must not be obeyed: forged, replayed, unsigned, of another key, from the future, to another address."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest
from link_bench import KEY, OTHER_KEY, Linked, Station, split_tlog
from pymavlink.dialects.v20 import common

from flightsw.icd import mavlink as m
from flightsw.link.access import MINUTE, Access, Ceiling, KeyFile, KeyRefused, Refusal, read_keys, signature
from flightsw.link_open import LinkOptions, LinkRefused, open_ground_link

ARM = common.MAV_CMD_COMPONENT_ARM_DISARM
ATTACKS = 10_000


def test_our_signature_is_pymavlinks() -> None:
    """GIVEN a frame that pymavlink has signed WHEN ours is computed THEN it is the same six bytes."""
    station = Station(key=KEY)
    station.command(ARM, 0.0)
    frame = station.packed[0]
    assert signature(KEY, frame[:-6]) == frame[-6:]


def test_what_flight_sends_is_signed_and_pymavlink_verifies_it() -> None:
    """GIVEN a key WHEN flight speaks THEN pymavlink with that key accepts every frame and with another none."""
    with Linked() as flight:
        flight.fly(until_s=3.0)
        frames = flight.wire.down
    for key, good in ((KEY, True), (OTHER_KEY, False)):
        reader = m.MAVLink(None)
        reader.signing.secret_key = key
        accepted = 0
        for frame in frames:
            try:
                reader.decode(bytearray(frame))
                accepted += 1
            except m.MAVError:
                pass
        assert accepted == (len(frames) if good else 0)


def attack(kind: str, rng: random.Random, flight: Linked, recorded: list[bytes]) -> bytes:
    """One frame that orders the flag to be disarmed and must not be obeyed."""
    unix_ns = flight.loop.unix_ns()
    station = Station(key={"unsigned": None, "wrong key": OTHER_KEY}.get(kind, KEY), system=rng.choice((255, 254, 7)))
    station.at(unix_ns)
    target = (1, 1)
    if kind == "wrong target":
        target = rng.choice(((2, 1), (1, 2), (255, 190), (99, 99)))
    if kind == "future":
        station.mav.signing.timestamp += MINUTE + rng.randrange(1, 1 << 40)
    if kind == "old":
        station.mav.signing.timestamp -= MINUTE + rng.randrange(1, 1 << 40)
    if kind == "replayed":
        return rng.choice(recorded)
    if kind == "wrong target":
        station.mav.signing.timestamp += rng.randrange(1 << 8)
    station.mav.signing.link_id = 3 if kind == "wrong target" else rng.randrange(256)
    station.command(ARM, 0.0, target=target)
    frame = bytearray(station.packed[0])
    if kind == "forged":  # one bit of what is signed or of the signature, checksum made right again
        place = rng.choice([*range(4, 7), *range(10, len(frame) - 15), *range(len(frame) - 13, len(frame))])
        frame[place] ^= 1 << rng.randrange(8)
        end = 10 + frame[1]
        crc = common.x25crc(bytes(frame[1:end]) + bytes((common.MAVLink_command_long_message.crc_extra,))).crc
        frame[end : end + 2] = crc.to_bytes(2, "little")
    return bytes(frame)


KINDS = ("forged", "replayed", "unsigned", "wrong key", "future", "old", "wrong target")


def test_none_of_ten_thousand_bad_orders_is_obeyed_and_none_locks_the_operator_out(tmp_path: Path) -> None:
    """GIVEN a flight that obeys its operator WHEN 10,000 bad orders of seven kinds come, with a good one every hundred
    THEN none of the bad is obeyed or acknowledged, each is counted, and every good one is obeyed in its tick."""
    rng = random.Random(5)
    with Linked("time.duration_s=1200", folder=tmp_path) as flight:
        flight.fly(until_s=2.0)
        assert flight.ask(ARM, 1.0) == common.MAV_RESULT_ACCEPTED
        # what an eavesdropper has heard: orders to disarm, which were obeyed then, and the flag armed again
        for _ in range(20):
            assert flight.ask(ARM, 0.0) == common.MAV_RESULT_ACCEPTED
        recorded = [f for f in flight.station.packed if f[7:10] == (76).to_bytes(3, "little")][1:]
        assert flight.ask(ARM, 1.0) == common.MAV_RESULT_ACCEPTED
        before, accepted = sum(flight.ground.uplink.refused), flight.ground.uplink.accepted
        obeyed = good = 0
        for sent in range(ATTACKS):
            flight.wire.up.append(attack(KINDS[sent % len(KINDS)], rng, flight, recorded))
            if sent % 10 == 9:
                if sent % 100 == 99:
                    good += 1
                    assert flight.ask(ARM, 1.0) == common.MAV_RESULT_ACCEPTED, "the operator is locked out"
                else:
                    flight.wire.heard()
                    flight.tick()
                    obeyed += len(flight.wire.heard("COMMAND_ACK"))
                obeyed += not flight.loop.armed
        refused = sum(flight.ground.uplink.refused) - before
    print(f"{obeyed} of {ATTACKS} bad orders obeyed, {refused} counted, {good} good ones obeyed; {flight.refused}")
    assert obeyed == 0
    assert refused == ATTACKS
    assert flight.ground.uplink.accepted == accepted + good
    six = {"WRONG_TARGET", "UNSIGNED", "BAD_SIGNATURE", "REPLAYED", "TOO_OLD", "FUTURE"}
    assert six <= set(flight.refused) <= six | {"STREAMS"}


def test_refusals_are_reported_as_an_event_and_in_the_counts() -> None:
    with Linked() as flight:
        flight.fly(until_s=1.0)
        flight.wire.up.extend(s.packed[0] for s in [unsigned()])
        flight.fly(until_s=3.0)
        link = flight.wire.heard("LEONAV_LINK")[-1]
        assert link.refused[Refusal.UNSIGNED] == 1
        assert [int(e["alert_id"]) for e in flight.loop.events.newest_first()].count(28) == 1


def unsigned() -> Station:
    station = Station(key=None)
    station.command(ARM, 0.0)
    return station


@pytest.mark.parametrize("pause_ticks", [0, 100])
def test_a_replay_across_a_restart_is_refused_and_the_operator_goes_on(tmp_path: Path, pause_ticks: int) -> None:
    """GIVEN orders that one flight obeyed WHEN it dies without warning and starts again, at once or 10 s later THEN not
    one of them is obeyed again, nor one that never arrived; a station that follows flight's stamps is obeyed."""
    with Linked(folder=tmp_path) as flight:
        flight.fly(until_s=2.0)
        for _ in range(5):
            assert flight.ask(ARM, 0.0) == common.MAV_RESULT_ACCEPTED
        late = Station(key=KEY, system=254).at(flight.loop.unix_ns())
        late.mav.signing.timestamp += MINUTE // 2  # signed, held back by somebody, within what flight would have taken
        late.command(ARM, 0.0)
        recorded = [*flight.station.packed, *late.packed]
    with Linked(folder=tmp_path) as again:  # nothing was closed or saved on the way
        again.fly(until_s=2.0 + pause_ticks * 0.1)
        again.wire.up.extend(recorded)
        again.tick()
        assert again.loop.armed
        assert again.refused == {"TOO_OLD": len(recorded)}
        heard = again.wire.down[-1]
        again.station.mav.signing.timestamp = int.from_bytes(heard[-12:-6], "little") + 1
        assert again.ask(ARM, 0.0) == common.MAV_RESULT_ACCEPTED


def test_the_disk_always_holds_a_ceiling_above_every_stamp_that_is_taken(tmp_path: Path) -> None:
    """GIVEN a disk that fails after the start WHEN time goes on THEN orders are refused before a stamp passes the
    ceiling on it; they are taken again once the disk is back."""
    ceiling = Ceiling(tmp_path / "c")
    access = Access(lambda: (KEY,), ceiling, 1_600_000_000_000_000_000)
    station = Station(key=KEY)
    unix_ns = 1_600_000_000_000_000_000
    access.keep_ahead(unix_ns)
    taken, refused = 0, 0
    (tmp_path / "c.new").mkdir()  # no file can be written there
    for second in range(300):
        now_ns = unix_ns + second * 1_000_000_000
        access.keep_ahead(now_ns)
        station.at(now_ns).command(ARM, 0.0)
        outcome = access.verify(station.packed[-1], now_ns)
        on_disk = Ceiling(tmp_path / "c").floor
        if outcome < 0:
            taken += 1
            assert int.from_bytes(station.packed[-1][-12:-6], "little") <= on_disk
        else:
            refused += 1
            assert outcome == Refusal.FUTURE
    assert taken == 181
    assert refused == 119
    assert ceiling.failed > 0
    (tmp_path / "c.new").rmdir()
    access.keep_ahead(unix_ns + 300_000_000_000)
    station.at(unix_ns + 300_000_000_000).command(ARM, 0.0)
    assert access.verify(station.packed[-1], unix_ns + 300_000_000_000) < 0


def test_many_senders_are_kept_account_of_and_old_ones_forgotten() -> None:
    """GIVEN 16 senders WHEN a 17th comes THEN it is refused until one of them has been silent for a minute; none of
    what was forgotten is taken again."""
    unix_ns = 1_600_000_000_000_000_000
    access = Access(lambda: (KEY,), None, unix_ns)
    frames = []
    for system in range(100, 117):
        station = Station(key=KEY, system=system).at(unix_ns)
        station.command(ARM, 0.0)
        frames.append(station.packed[0])
    outcomes = [access.verify(frame, unix_ns) for frame in frames]
    assert outcomes == [-1] * 16 + [Refusal.STREAMS]
    later_ns = unix_ns + 61_000_000_000
    station = Station(key=KEY, system=116).at(later_ns)
    station.command(ARM, 0.0)
    assert access.verify(station.packed[0], later_ns) == -1
    assert access.verify(frames[0], later_ns) == Refusal.TOO_OLD


def test_a_read_only_request_needs_no_signature_from_a_known_peer_and_is_refused_from_a_stranger() -> None:
    with Linked() as flight:
        flight.fly(until_s=1.0)
        asker = Station(flight.wire, key=None)
        asker.mav.param_request_read_send(1, 1, b"LNK_REPEAT_S", -1)
        flight.tick()
        assert flight.refused == {"PEER": 1}
        assert not flight.wire.heard("PARAM_VALUE")
        assert flight.ask(ARM, 1.0) == common.MAV_RESULT_ACCEPTED  # the address has proven itself
        asker.mav.param_request_read_send(1, 1, b"LNK_REPEAT_S", -1)
        flight.tick()
        assert len(flight.wire.heard("PARAM_VALUE")) == 1


def test_nobody_speaks_for_flight() -> None:
    with Linked() as flight:
        flight.fly(until_s=1.0)
        twin = Station(flight.wire, key=KEY, system=1).at(flight.loop.unix_ns())
        twin.mav.srcComponent = 1
        twin.command(ARM, 0.0)
        flight.tick()
        assert flight.loop.armed
        assert flight.refused == {"PEER": 1}


# -- key files


def write_key(path: Path, *keys: bytes, mode: int = 0o600) -> Path:
    path.write_text("".join(key.hex() + "\n" for key in keys))
    path.chmod(mode)
    return path


def test_a_key_file_holds_one_or_two_keys(tmp_path: Path) -> None:
    assert read_keys(write_key(tmp_path / "k", KEY)) == (KEY,)
    assert read_keys(write_key(tmp_path / "k", KEY, OTHER_KEY)) == (KEY, OTHER_KEY)


@pytest.mark.parametrize(
    ("content", "mode", "says"),
    [
        (KEY.hex(), 0o644, "chmod 600"),
        (KEY.hex(), 0o620, "chmod 600"),
        ("", 0o600, "64 hexadecimal"),
        ("00" * 31, 0o600, "64 hexadecimal"),
        ("zz" * 32, 0o600, "64 hexadecimal"),
        (f"{'00' * 32}\n" * 3, 0o600, "64 hexadecimal"),
    ],
)
def test_an_unfit_key_file_is_refused_in_words(tmp_path: Path, content: str, mode: int, says: str) -> None:
    path = tmp_path / "k"
    path.write_text(content)
    path.chmod(mode)
    with pytest.raises(KeyRefused, match=says):
        read_keys(path)


def test_keys_are_changed_while_flight_runs(tmp_path: Path) -> None:
    """GIVEN a key in use WHEN the file gets a new first key THEN both are accepted and the new one signs; WHEN the old
    one is taken away THEN it is refused; a file that has become unfit changes nothing."""
    path = write_key(tmp_path / "k", KEY)
    held = KeyFile(path)

    def look() -> tuple[bytes, ...]:
        os.utime(path, ns=(held._seen + 1, held._seen + 1))
        for _ in range(60):
            held.work_slice()
        return held.keys

    write_key(path, OTHER_KEY, KEY)
    assert look() == (OTHER_KEY, KEY)
    path.write_text("nonsense")
    assert look() == (OTHER_KEY, KEY)
    write_key(path, OTHER_KEY)
    assert look() == (OTHER_KEY,)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (LinkOptions(("udp:127.0.0.1:1",), key=Path("k"), bench=True), "one of the two"),
        (LinkOptions(("udp:127.0.0.1:1",), key=Path("k")), "--link-state"),
        (LinkOptions(("udpin:0.0.0.0:0",)), "--link-key"),
        (LinkOptions(("tcpin:0.0.0.0:0",), bench=True), "127.0.0.1"),
        (LinkOptions(("udp:192.0.2.1:14550",), bench=True), "127.0.0.1"),
        (LinkOptions(("udp:nowhere",)), "udpin:"),
        (LinkOptions(("smoke:127.0.0.1:1",)), "udpin:"),
        (LinkOptions(("udpin:127.0.0.1:99999",)), "udpin:"),
        (LinkOptions(("serial:/nowhere:57600",)), "cannot be opened"),
        (LinkOptions(("serial:nowhere",)), "serial:DEVICE:BAUD"),
    ],
)
def test_an_unsafe_or_impossible_link_is_refused_in_words(options: LinkOptions, says: str) -> None:
    with pytest.raises(LinkRefused, match=says):
        open_ground_link(options, 0)


def test_a_damaged_ceiling_is_refused(tmp_path: Path) -> None:
    ceiling = Ceiling(tmp_path / "c")
    ceiling.keep_ahead(10 * MINUTE)
    raw = (tmp_path / "c").read_bytes()
    for place in range(len(raw)):
        (tmp_path / "c").write_bytes(raw[:place] + bytes((raw[place] ^ 4,)) + raw[place + 1 :])
        with pytest.raises(KeyRefused, match="change the key"):
            Ceiling(tmp_path / "c")


def test_the_journal_has_what_was_taken_and_nothing_that_was_refused(tmp_path: Path) -> None:
    """GIVEN good and bad orders WHEN link.tlog is read THEN the good ones are in it at their tick, as they came."""
    with Linked(logs=tmp_path) as flight:
        flight.fly(until_s=1.0)
        flight.wire.up.append(unsigned().packed[0])
        flight.ask(ARM, 0.0)
        unix_us = flight.loop.unix_ns() // 1000
    taken = [(t, frame) for t, frame in split_tlog(tmp_path / "link.tlog") if frame[5] != 1]
    assert taken == [(unix_us, flight.station.packed[-1])]
