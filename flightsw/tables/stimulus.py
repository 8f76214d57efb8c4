"""The stimulus of a certificate: inputs of the navigation step through every mode, and what the step answered.

Preflight replays it: a change of the code that keeps the numbers keeps the certificate, a miscompiled kernel does not
fly. It is flown in a world of its own, made here from exact arithmetic, so that it needs no table but its own.

    magic "LNAVSTM1" | steps u16 | fields u16 | length of the columns u32
    | each field: name, 32 bytes ASCII, zero-padded | 'I' or 'O' | 'f' or 'i' | elements u16
    | deflated: each field of all steps, its first bytes, its second bytes, ... its eighth bytes

Fields are found by name: one that a later version has besides is zero on the way in and not compared on the way out.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from flightsw.icd.enums import FlagState, Mode
from flightsw.icd.table_schema import EARTH_ORIENTATION, FORCES, GRAVITY_FIELD, Schema
from flightsw.memory import Memory
from flightsw.nav.step import step
from flightsw.records import INPUT, OUTPUT

MAGIC = b"LNAVSTM1"
STEPS_MAX = 200
TOLERANCE = 1e-9
T0_GPS_NS = 1_400_000_000_000_000_000

_HEADER = struct.Struct("<8sHHI")
_FIELD = struct.Struct("<32sccH")
_FIELDS_MAX = 512
_SLICE = 10  # steps replayed at a turn
_NODES = 16
_NODE_STEP_NS = 21_600_000_000_000
# Differences of large numbers, and statistics made of them: the tolerance is that of what they are made from.
_SIZES = {"r_gcrf_m": 1.0, "v_gcrf_mps": 1.0, "da_gcrf_mps2": 1e-2, "innovation": 7e6, "drag_scale": 1.0}
_STATISTICS = ("nis", "mean_nis", "type_nis", "monitor_statistic")
_STATISTIC_SIZE = 1e3


class StimulusRefused(ValueError):
    """A stimulus that cannot be read, or that this software answers otherwise; the text says where."""


class Stimulus(NamedTuple):
    """inputs: (n,) of records.INPUT. answers: name of an OUTPUT field -> values of all steps (n, elements)."""

    inputs: np.ndarray
    answers: dict[str, np.ndarray]


def _columns(records: np.ndarray, name: str) -> np.ndarray:
    return np.ascontiguousarray(records[name].reshape(len(records), -1))


def encode(inputs: np.ndarray, outputs: np.ndarray) -> bytes:
    """Bytes of a stimulus. inputs: (n,) of INPUT, outputs: (n,) of OUTPUT, n at most 200."""
    if not 0 < len(inputs) == len(outputs) <= STEPS_MAX:
        raise ValueError(f"{len(inputs)} inputs and {len(outputs)} outputs; give 1 to {STEPS_MAX} of each")
    heads, planes = [], []
    for side, records in ((b"I", inputs), (b"O", outputs)):
        for name in records.dtype.names or ():
            values = _columns(records, name)
            heads.append(_FIELD.pack(name.encode("ascii"), side, values.dtype.kind.encode(), values.shape[1]))
            planes.append(values.view(np.uint8).reshape(-1, 8).T.tobytes())
    columns = b"".join(planes)
    head = _HEADER.pack(MAGIC, len(inputs), len(heads), len(columns))
    return head + b"".join(heads) + zlib.compress(columns, 9)


def decode(raw: bytes) -> Stimulus:
    """Open a stimulus. Raises StimulusRefused where it is not whole, or tells the step what this software lacks."""
    if len(raw) < _HEADER.size:
        raise StimulusRefused(f"stimulus of {len(raw)} bytes is too short")
    magic, steps, count, length = _HEADER.unpack_from(raw)
    columns_at = _HEADER.size + count * _FIELD.size
    if magic != MAGIC or not 0 < steps <= STEPS_MAX or count > _FIELDS_MAX or len(raw) < columns_at:
        raise StimulusRefused("not a stimulus (magic, steps or fields are wrong)")
    fields = [_FIELD.unpack_from(raw, _HEADER.size + k * _FIELD.size) for k in range(count)]
    if length != 8 * steps * sum(elements for *_, elements in fields):
        raise StimulusRefused("stimulus: its fields do not fill its columns")
    inflate = zlib.decompressobj()
    try:
        columns = inflate.decompress(raw[columns_at:], length)
    except zlib.error as error:
        raise StimulusRefused(f"stimulus: damaged ({error})") from error
    if len(columns) != length or inflate.unconsumed_tail or inflate.unused_data:
        raise StimulusRefused("stimulus: its columns are not of the length announced")
    inputs = np.zeros(steps, INPUT)
    answers: dict[str, np.ndarray] = {}
    place = 0
    for raw_name, side, kind, elements in fields:
        size = 8 * steps * elements
        plane = np.frombuffer(columns, np.uint8, size, place).reshape(8, -1)
        values = np.ascontiguousarray(plane.T).view("<f8" if kind == b"f" else "<i8").reshape(steps, elements)
        place += size
        _put(inputs, answers, raw_name.rstrip(b"\0").decode("ascii", "replace"), side, values)
    return Stimulus(inputs, answers)


def _put(inputs: np.ndarray, answers: dict[str, np.ndarray], name: str, side: bytes, values: np.ndarray) -> None:
    record = inputs.dtype if side == b"I" else OUTPUT
    known = record[name] if name in (record.names or ()) else None
    if known is None or known.base != values.dtype or int(np.prod(known.shape)) != values.shape[1]:
        word = "input" if side == b"I" else "output"
        raise StimulusRefused(f"stimulus: {word} {name} is not what this software has; certify the table again")
    if side == b"I":
        inputs[name] = values.reshape(inputs[name].shape)
    else:
        answers[name] = values


def memory_for(navigation: np.ndarray) -> Memory:
    """A memory with this navigation table (1,) and the world of the stimulus: nothing else decides its answers."""
    memory = Memory()
    memory.load(navigation, _orientation())
    forces = _defaults(FORCES)
    memory.load_forces(forces, _gravity_field())
    return memory


def _defaults(schema: Schema) -> np.ndarray:
    values = np.zeros(1, schema.dtype)
    for field in schema.fields:
        if field.default is not None:
            values[field.name] = field.default
    return values


def _orientation() -> np.ndarray:
    values = _defaults(EARTH_ORIENTATION)
    values["t0_gps_ns"] = T0_GPS_NS - 4 * _NODE_STEP_NS
    values["step_ns"] = _NODE_STEP_NS
    values["count"] = _NODES
    for k in range(_NODES):
        values["nodes"][0, k] = (1e-3 + k * 1e-8, -2e-5 + k * 1e-9, 1e-8, 5e-7, 1.5e-6, -17.9 - k * 1e-4)
    return values


def _gravity_field() -> np.ndarray:
    """Coefficients of about the size of Earth's (Kaula: 1e-5 / n^2), of whole numbers: the same on any machine."""
    values = _defaults(GRAVITY_FIELD)
    degree = int(_defaults(FORCES)["degree"][0])
    values["gm_m3ps2"], values["radius_m"], values["degree"] = 3.986004415e14, 6378136.3, degree
    coefficients = values["coefficients"][0]
    coefficients[0] = 1.0
    for n in range(2, degree + 1):
        for m in range(n + 1):
            at = n * (n + 1) + 2 * m
            coefficients[at] = ((37 * n + 101 * m) % 97 - 48) / 48.0 * 1e-5 / (n * n)
            coefficients[at + 1] = ((53 * n + 71 * m) % 89 - 44) / 44.0 * 1e-5 / (n * n) if m else 0.0
    coefficients[6] = -4.84e-4
    return values


def _answer(memory: Memory, inputs: np.ndarray) -> Generator[None, None, np.ndarray]:
    """What the step says to each of the inputs (n,), from a state forgotten: (n,) of OUTPUT."""
    memory.reset()
    outputs = np.zeros(len(inputs), OUTPUT)
    for k in range(len(inputs)):
        if k % _SLICE == 0:
            yield
        say(memory, inputs[k : k + 1])
        outputs[k] = memory.output[0]
    return outputs


def say(memory: Memory, one_input: np.ndarray) -> None:
    """One step with this input (1,); its answer stands in memory.output."""
    step(
        memory.nav,
        one_input,
        memory.table,
        memory.orientation,
        memory.forces,
        memory.field,
        memory.work,
        memory.scratch,
        memory.output,
    )


def check(raw: bytes, navigation: np.ndarray) -> bool:
    """Replay a stimulus on its navigation table (1,). Returns whether all bits are equal; some may differ by 1e-9.

    Raises StimulusRefused naming the first step and field that differ by more.
    """
    work = check_in_slices(raw, navigation)
    while True:
        try:
            next(work)
        except StopIteration as end:
            return bool(end.value)


def check_in_slices(raw: bytes, navigation: np.ndarray) -> Generator[None, None, bool]:
    """As `check`, a few milliseconds of work at each turn."""
    stimulus = decode(raw)
    yield
    memory = memory_for(navigation)
    outputs = yield from _answer(memory, stimulus.inputs)
    yield
    identical = True
    worst: tuple[int, str, float, float] | None = None
    for name, expected in stimulus.answers.items():
        found = _columns(outputs, name)
        if found.tobytes() == expected.tobytes():
            continue
        identical = False
        wrong = ~_close(name, found, expected)
        if wrong.any():
            at, element = (int(i) for i in np.argwhere(wrong)[0])
            if worst is None or at < worst[0]:
                worst = (at, name, float(expected[at, element]), float(found[at, element]))
    if worst is not None:
        at, name, expected_value, value = worst
        raise StimulusRefused(
            f"stimulus: step {at} of {len(outputs)}, {name}: {value!r} where {expected_value!r} was certified; "
            "this software does not compute what was certified: certify the table again, or fly the software it names"
        )
    return identical


def _close(name: str, found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Whether each value is that expected, (n, elements): whole numbers exactly, others to TOLERANCE."""
    if found.dtype.kind == "i":
        return found == expected
    finite = np.isfinite(expected)
    if name == "covariance":  # each element by its two variances: of metres and of millimetres a second
        diagonal = np.sqrt(np.abs(np.einsum("nii->ni", np.where(finite, expected, 1.0).reshape(-1, 6, 6))))
        size = (diagonal[:, :, None] * diagonal[:, None, :]).reshape(found.shape)
    elif name in _STATISTICS:
        size = np.maximum(np.abs(expected), _STATISTIC_SIZE)
    elif name in _SIZES:
        norm = np.sqrt(np.sum(np.where(finite, expected, 0.0) ** 2, axis=1, keepdims=True))
        size = np.broadcast_to(np.maximum(norm, _SIZES[name]), found.shape)
    else:
        size = np.abs(expected)
    with np.errstate(invalid="ignore"):
        near = np.abs(found - expected) <= TOLERANCE * size
    return np.where(finite, near, (found == expected) | (np.isnan(found) & np.isnan(expected)))


def missing(inputs: np.ndarray, outputs: np.ndarray) -> list[str]:
    """What a stimulus does not pass through, of all that it should; empty for a good one."""
    modes = set(outputs["mode"].tolist())
    flags = outputs["flag"]
    raised = np.flatnonzero(flags == FlagState.RAISED)
    burns = np.flatnonzero(inputs["burn_present"])
    said = [f"mode {mode.name}" for mode in Mode if int(mode) not in modes]
    if not burns.size:
        said.append("a burn")
    if not raised.size:
        said.append("the flag")
    elif not (flags[raised[-1] :] == FlagState.CLEAR).any():
        said.append("the return to service")
    elif outputs["mode"][-1] != Mode.INTEGRATED:
        said.append("mode INTEGRATED after the flag")
    return said
