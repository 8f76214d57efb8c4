"""Epochs from pseudoranges to fixes with protection levels, in one call: for studies, which have all of them at once.

In flight the parts are in ticks of their own: flightsw/pseudoranges/function.py.
"""

from __future__ import annotations

from flightsw.gnss.declare import ROOM, entry
from flightsw.gnss.fix import exclude, test
from flightsw.gnss.protection import protect
from flightsw.gnss.records import EPOCH, GNSS_TABLE, RESULT, WORK
from flightsw.kernels.registry import frozen_records, records


def _declare(room):
    @entry(frozen_records(GNSS_TABLE), records(EPOCH), records(WORK), records(RESULT))
    def gnss_epoch(tables, epochs, works, results):
        """Judge the epochs of an array, one after the other, each into its result."""
        table, work = tables[0], works[0]
        for k in range(epochs.shape[0]):
            test(table, epochs[k], work, results[k], room)
            exclude(table, epochs[k], work, results[k])
            protect(table, work, results[k])

    return gnss_epoch


gnss_epoch = _declare(ROOM)
