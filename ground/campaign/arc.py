"""An arc: the compiled `for` around the navigation step. What flies is what is tuned, to the bit."""

from __future__ import annotations

import numpy as np

from flightsw.kernels.registry import entry, frozen_records, records
from flightsw.memory import Memory
from flightsw.nav.step import step
from flightsw.records import FIELD, FORCE_TABLE, FORCE_WORK, INPUT, NAV, ORIENTATION, OUTPUT, TABLE, WORK


@entry(
    records(NAV),
    records(INPUT),
    frozen_records(TABLE),
    frozen_records(ORIENTATION),
    frozen_records(FORCE_TABLE),
    frozen_records(FIELD),
    records(WORK),
    records(FORCE_WORK),
    records(OUTPUT),
)
def _fly(nav, inputs, table, orientation, forces, field, work, scratch, outputs):
    for index in range(inputs.shape[0]):
        at = slice(index, index + 1)
        step(nav, inputs[at], table, orientation, forces, field, work, scratch, outputs[at])


def fly(memory: Memory, inputs: np.ndarray, outputs: np.ndarray | None = None) -> np.ndarray:
    """Fly a whole arc from the state in `memory`.

    Args: inputs (n,) of `records.INPUT`, in order of time; outputs (n,) of `records.OUTPUT` to fill. Returns them,
    or new ones: one for each input.
    """
    if outputs is None:
        outputs = np.zeros(len(inputs), OUTPUT)
    _fly(
        memory.nav,
        inputs,
        memory.table,
        memory.orientation,
        memory.forces,
        memory.field,
        memory.work,
        memory.scratch,
        outputs,
    )
    return outputs
