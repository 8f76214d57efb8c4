"""Whatever is done to a frame, it never changes the state: a hundred thousand of them against a twin that got none.

Both twins start each example from the same settled record. One gets the world's frames and the mutated ones, the other
the world's alone; after every tick their states must be the same bits. Each mutated frame must be counted under its
cause, and the telemetry must show that count.
"""

from __future__ import annotations

import random
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

import pytest
from harness import Flight, Telemetry, load, reseal
from hypothesis import given, settings
from hypothesis import strategies as st
from impossible_frames import ATTITUDE, BURN, COMMAND, IMPOSSIBLE, UNSENT, put_field

from flightsw.icd.can_codec import OK, decode_into
from flightsw.icd.can_frames import LAYOUTS
from flightsw.icd.enums import REJECT_CAUSES, RejectCause

SYNC, POSITION, VELOCITY = 0x100, 0x110, 0x111
SENSOR_IDS = (SYNC, POSITION, VELOCITY, BURN, ATTITUDE, COMMAND)
SETTLED_S = 60.0
EXAMPLES = 112
FRAMES = 1000  # mutated frames an example puts on the bus
PER_TICK = 28
CAN_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)

Frames = list[tuple[int, bytes]]
told = Counter[str]()


class Twins(NamedTuple):
    """A flight that gets mutated frames, one that does not, and where both stood when settled."""

    struck: Flight
    spared: Flight
    nav: bytes
    k: int


@pytest.fixture(scope="module")
def twins() -> Iterator[Twins]:
    loaded = load(f"time.duration_s={SETTLED_S + 10}", "flight.table.rate_counters_ticks=1")
    with Flight(loaded, sink=Telemetry()) as struck, Flight(loaded) as spared:
        for flight in (struck, spared):
            flight.fly(SETTLED_S)
        yield Twins(struck, spared, struck.nav.tobytes(), struck.k)
    if any(name.startswith("content") for name in told) and "BAD_CRC" in told:  # both tests below were run
        assert told.total() >= 100_000, told


class Stream:
    """Gives the frames of one flight alive counters without a gap, whatever was taken out or put in."""

    def __init__(self, flight: Flight) -> None:
        self.flight = flight
        self.next = dict.fromkeys(SENSOR_IDS, 0)
        for inbox in flight.loop.receiver._inboxes.values():
            inbox.counter = -1

    def put(self, frame_id: int, payload: bytes) -> bytes:
        """Send with the next counter and a right CRC; returns what was sent."""
        sealed = reseal(frame_id, payload, self.next[frame_id])
        self.next[frame_id] = (self.next[frame_id] + 1) & 0xFF
        self.flight.put(frame_id, sealed)
        return sealed


def settle(flight: Flight, twins: Twins) -> None:
    flight.nav.view("u1")[:] = memoryview(twins.nav)
    flight.loop._assembly._position = flight.loop._assembly._velocity = None
    flight.k = twins.k
    if isinstance(flight.loop.telemetry._out._sink, Telemetry):
        flight.loop.telemetry._out._sink.clear()


# -- damage on the way: nothing fits any more, so each such frame may come at any time --------------------------


def flipped(rng: random.Random, good: Frames) -> tuple[int, bytes, str]:
    """One to three bits, or a burst within sixteen: what a 16-bit CRC finds without exception."""
    frame_id, payload = rng.choice(good)
    bits = int.from_bytes(payload)
    width = 8 * len(payload)
    if rng.random() < 0.5:
        for bit in rng.sample(range(width), rng.randint(1, 3)):
            bits ^= 1 << bit
    else:
        bits ^= (rng.getrandbits(16) | 1) << rng.randrange(width - 16)
    return frame_id, bits.to_bytes(len(payload)), "BAD_CRC"


def cut_or_longer(rng: random.Random, good: Frames) -> tuple[int, bytes, str]:
    frame_id, payload = rng.choice(good)
    length = rng.choice([n for n in CAN_FD_LENGTHS if n != len(payload)])
    return frame_id, (payload + rng.randbytes(64))[:length], "BAD_LENGTH"


def misaddressed(rng: random.Random, good: Frames) -> tuple[int, bytes, str]:
    """A good frame under another identifier: of flight, of a sensor, of nobody."""
    frame_id, payload = rng.choice(good)
    other = rng.choice([one for one in (*LAYOUTS, *range(0x7F0, 0x800), 0x101, 0x112) if one != frame_id])
    if other not in SENSOR_IDS:
        return other, payload, "UNKNOWN_ID"
    return other, payload, "BAD_CRC" if LAYOUTS[other].length == len(payload) else "BAD_LENGTH"


def noise(rng: random.Random, good: Frames) -> tuple[int, bytes, str]:
    """Any bytes of the right length, but for the one in 65536 that happens to have a right CRC."""
    layout = LAYOUTS[rng.choice(SENSOR_IDS)]
    while True:
        payload = rng.randbytes(layout.length)
        if decode_into(layout, payload, bytearray(layout.length)) != OK:
            return layout.frame_id, payload, "BAD_CRC"


DAMAGE = (flipped, cut_or_longer, misaddressed, noise)


@settings(max_examples=EXAMPLES // 2)
@given(seed=st.integers(0, 2**32), damage=st.sampled_from([*DAMAGE, None]))
def test_damaged_frames_change_no_state(
    twins: Twins, seed: int, damage: Callable[[random.Random, Frames], tuple[int, bytes, str]] | None
) -> None:
    """GIVEN settled flight WHEN frames are flipped, cut, lengthened, misaddressed, repeated or mere noise, among good
    ones, in any order THEN state as in the twin after each tick; each counted under its own cause, and told.
    """
    rng = random.Random(seed)
    struck, spared = twins.struck, twins.spared
    for flight in (struck, spared):
        settle(flight, twins)
    streams = Stream(struck), Stream(spared)
    before = Counter(struck.counts)
    expected = Counter[str]()
    recent: Frames = [one for k in range(struck.k - 12, struck.k) for one in struck.world.frames_due(k)] + UNSENT
    while expected.total() < FRAMES:
        mutated = [(damage or rng.choice(DAMAGE))(rng, recent) for _ in range(PER_TICK)]
        for frame_id, payload in struck.world.frames_due(struck.k):
            put_some(struck, mutated, rng, expected)
            sealed = streams[0].put(frame_id, payload)
            streams[1].put(frame_id, payload)
            if damage is None:  # and the very same frame once more
                struck.put(frame_id, sealed)
                expected["REPEATED_COUNTER"] += 1
        while mutated:
            put_some(struck, mutated, rng, expected)
        step_both(struck, spared)
    check_counts(struck, before, expected)
    told.update(expected)


# -- wrong content under a right CRC: a faulty sensor, not a faulty bus ----------------------------------------


def wrong_time(rng: random.Random) -> int:
    """Nanoseconds off: by 1 ms and more, either way, up to the end of int64."""
    size = rng.choice([10 ** rng.uniform(6.1, 9.0), 10 ** rng.uniform(9.0, 18.0), 604800e9 * 1024])
    return round(size) * rng.choice([-1, 1])


def clip(value: int) -> int:
    return max(-(2**63), min(2**63 - 1, value))


def fix_of_wrong_time(rng: random.Random, position: bytes, velocity: bytes) -> Frames:
    t = clip(struct.unpack_from("<q", position)[0] + wrong_time(rng))
    if rng.random() < 0.3:
        t = struct.unpack("<q", rng.randbytes(8))[0]
    return [
        (POSITION, put_field(POSITION, position, "t_gps_ns", t)),
        (VELOCITY, put_field(VELOCITY, velocity, "t_gps_ns", t)),
    ]


def fix_of_wrong_counter(rng: random.Random, position: bytes, velocity: bytes) -> Frames:
    latched = clip(struct.unpack_from("<q", position, 8)[0] + wrong_time(rng))
    return [(POSITION, put_field(POSITION, position, "t_counter_ns", latched)), (VELOCITY, velocity)]


def fix_of_no_numbers(rng: random.Random, position: bytes, velocity: bytes) -> Frames:
    bad = rng.choice([float("nan"), float("inf"), float("-inf")])
    axis, target = rng.choice("xyz"), rng.randrange(4)
    if target == 0:
        position = put_field(POSITION, position, f"{axis}_itrf_m", bad)
    elif target == 1:
        position = put_field(POSITION, position, f"sigma_{axis}_m", bad)
    elif target == 2:
        velocity = put_field(VELOCITY, velocity, f"v{axis}_itrf_mps", bad)
    else:
        velocity = put_field(VELOCITY, velocity, f"sigma_v{axis}_mps", bad)
    return [(POSITION, position), (VELOCITY, velocity)]


def fix_of_absurd_numbers(rng: random.Random, position: bytes, velocity: bytes) -> Frames:
    axis, size = rng.choice("xyz"), 10 ** rng.uniform(7.5, 300.0) * rng.choice([-1, 1])
    target = rng.randrange(5)
    if target == 0:
        position = put_field(POSITION, position, f"{axis}_itrf_m", size)
    elif target == 1:
        velocity = put_field(VELOCITY, velocity, f"v{axis}_itrf_mps", size)
    elif target == 2:
        position = put_field(POSITION, position, f"sigma_{axis}_m", rng.choice([0.0, -1.0, 1e4, 3e38, -3e38]))
    elif target == 3:
        position = put_field(POSITION, position, "satellites", rng.randint(0, 3))
    else:
        position = put_field(POSITION, position, "fix_type", rng.choice([0, 1, 2, 5, 255]))
    return [(POSITION, position), (VELOCITY, velocity)]


def swapped(rng: random.Random, position: bytes, velocity: bytes) -> Frames:
    """Payload of the one in the frame of the other, or nothing but zeros or noise, under the right CRC."""
    spare = rng.choice([bytes(64), b"\xff" * 64, rng.randbytes(64)])
    return rng.choice(
        [
            [(POSITION, velocity), (VELOCITY, position)],
            [(POSITION, velocity), (VELOCITY, velocity)],
            [(POSITION, position), (VELOCITY, position)],
            [(POSITION, spare), (VELOCITY, spare)],
        ]
    )


def pulse_of_wrong_content(rng: random.Random, pulse: bytes) -> bytes:
    t, latched = struct.unpack_from("<qq", pulse)
    kind = rng.randrange(5)
    if kind == 0:
        return put_field(SYNC, pulse, "t_gps_ns", clip(t + wrong_time(rng)))
    if kind == 1:
        return put_field(SYNC, pulse, "t_counter_ns", clip(latched + wrong_time(rng)))
    if kind == 2:
        return put_field(SYNC, pulse, "sigma_ns", rng.choice([float("nan"), float("inf"), -1.0, 1e30]))
    if kind == 3:
        return put_field(SYNC, pulse, "status", rng.choice([0, *range(2, 256)]))
    return put_field(SYNC, rng.randbytes(32), "status", 1)


CONTENT = (fix_of_wrong_time, fix_of_wrong_counter, fix_of_no_numbers, fix_of_absurd_numbers, swapped)
CONTENT_CAUSES = {
    *("NOT_FINITE", "OUT_OF_RANGE", "FIX_TYPE", "SATELLITES", "SIGMA"),
    *("TIME_STALE", "TIME_FUTURE", "TIME_JUMP", "TIME_REPEATED", "SYNC_JUMP", "SYNC_INVALID"),
}


@settings(max_examples=EXAMPLES // 2)
@given(seed=st.integers(0, 2**32), content=st.sampled_from([*CONTENT, None]))
def test_wrong_content_under_a_right_crc_changes_no_state(
    twins: Twins, seed: int, content: Callable[[random.Random, bytes, bytes], Frames] | None
) -> None:
    """GIVEN settled flight WHEN whole epochs of stale, future or garbled times, NaN, absurd or swapped content come
    among the good ones, intact by CRC and counter THEN state as in the twin after each tick; each counted, and told.
    """
    rng = random.Random(seed)
    struck, spared = twins.struck, twins.spared
    for flight in (struck, spared):
        settle(flight, twins)
    streams = Stream(struck), Stream(spared)
    before = Counter(struck.counts)
    recent = dict(one for k in range(struck.k - 12, struck.k) for one in struck.world.frames_due(k))
    sent = wrong = 0
    while sent < FRAMES:
        due = struck.world.frames_due(struck.k)
        recent.update(due)
        first_good = rng.random() < 0.5
        if first_good:
            put_all(streams, due)
        for _ in range(14 - len(due)):
            if content is None or rng.random() < 0.1:
                streams[0].put(SYNC, pulse_of_wrong_content(rng, recent[SYNC]))
                sent += 1
            else:
                for frame_id, payload in content(rng, recent[POSITION], recent[VELOCITY]):
                    streams[0].put(frame_id, payload)
                    sent += 1
            wrong += 1
        if not first_good:
            put_all(streams, due)
        step_both(struck, spared)
    after = Counter(struck.counts)
    after.subtract(before)
    causes = +after
    assert set(causes) <= CONTENT_CAUSES | {"INCOMPLETE_EPOCH", "RECEIVE_OVERFLOW"}, causes
    if content is not swapped:  # swapped halves mostly find no partner: they are counted as such, one by one
        assert sum(causes.values()) == wrong
    else:
        assert sum(causes.values()) >= wrong - 2
    shown(struck)
    told[f"content: {content.__name__ if content else 'pulses'}"] += sent


@settings(max_examples=EXAMPLES // 4)
@given(seed=st.integers(0, 2**32))
def test_wrong_burns_attitudes_and_commands_change_no_state(twins: Twins, seed: int) -> None:
    """GIVEN settled flight WHEN impossible burns, attitudes and commands come among the good fixes, intact by CRC and
    counter THEN state as in the twin after each tick; each counted under its own cause, and told."""
    rng = random.Random(seed)
    struck, spared = twins.struck, twins.spared
    for flight in (struck, spared):
        settle(flight, twins)
    streams = Stream(struck), Stream(spared)
    before = Counter(struck.counts)
    expected = Counter[str]()
    while expected.total() < FRAMES // 5:
        put_all(streams, struck.world.frames_due(struck.k))
        for _ in range(12):
            frame_id = rng.choice(list(IMPOSSIBLE))
            make, cause = IMPOSSIBLE[frame_id]
            streams[0].put(frame_id, make(rng))
            expected[cause] += 1
        step_both(struck, spared)
    check_counts(struck, before, expected)


def put_some(struck: Flight, mutated: list[tuple[int, bytes, str]], rng: random.Random, expected: Counter[str]) -> None:
    """Send some of the mutated frames and take them off the list."""
    for _ in range(min(len(mutated), rng.randint(1, PER_TICK))):
        frame_id, payload, cause = mutated.pop()
        struck.put(frame_id, payload)
        expected[cause] += 1


def put_all(streams: tuple[Stream, Stream], due: Frames) -> None:
    for frame_id, payload in due:
        for stream in streams:
            stream.put(frame_id, payload)


def step_both(struck: Flight, spared: Flight) -> None:
    for flight in (struck, spared):
        flight.tick(with_world=False)
    assert struck.fingerprints[-1] == spared.fingerprints[-1]
    assert struck.flown[-1]["r_gcrf_m"].tobytes() == spared.flown[-1]["r_gcrf_m"].tobytes()


def check_counts(struck: Flight, before: Counter[str], expected: Counter[str]) -> None:
    after = Counter(struck.counts)
    after.subtract(before)
    assert +after == expected
    shown(struck)


def shown(struck: Flight) -> None:
    """The newest LEONAV_COUNTERS shows what flight has counted."""
    message = struck.loop.telemetry._out._sink.of("LEONAV_COUNTERS")[-1]
    counts = {RejectCause(i).name: message.rejected[i] for i in range(REJECT_CAUSES) if message.rejected[i]}
    assert counts == struck.counts
