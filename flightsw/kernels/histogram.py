"""Durations into a histogram of octaves cut in eight, many in one call."""

from __future__ import annotations

from flightsw.kernels.registry import F8, TIMES, entry, kernel

# A duration falls into bin 8 * octave + eighth of the octave: 12 % wide, from 1 ns to 18 minutes.
EIGHTHS = 3
OCTAVES = 41
BINS = OCTAVES << EIGHTHS
RUNS, TOTAL_NS, LONGEST_NS, OVER = 0, 1, 2, 3  # places in an account
ACCOUNT = 4


@kernel
def bin_of(duration_ns):
    """Histogram bin of a duration."""
    octave, rest = 0, duration_ns
    while rest > 0:
        octave += 1
        rest >>= 1
    if octave <= EIGHTHS:
        return duration_ns
    if octave >= OCTAVES:
        return BINS - 1
    return (octave << EIGHTHS) | ((duration_ns >> (octave - 1 - EIGHTHS)) & 7)


def upper_edge_ns(index: int) -> float:
    """Largest duration of a bin."""
    octave, eighth = index >> EIGHTHS, index & 7
    if octave <= EIGHTHS:
        return float(index)
    return float(((8 + eighth + 1) << (octave - 1 - EIGHTHS)) - 1)


@entry(TIMES, F8, F8, TIMES, TIMES)
def enter(durations_ns, count, budget_ns, histogram, account):
    """Enter the first so many durations: into a histogram (BINS,) and an account (ACCOUNT,), both int64."""
    for k in range(int(count)):
        duration_ns = durations_ns[k]
        histogram[bin_of(duration_ns)] += 1
        account[RUNS] += 1
        account[TOTAL_NS] += duration_ns
        account[LONGEST_NS] = max(account[LONGEST_NS], duration_ns)
        if duration_ns > budget_ns:
            account[OVER] += 1
