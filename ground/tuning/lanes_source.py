"""Writes lanes_step.py: one step of (17) for sixteen covariances side by side, with nothing left to be decided.

`python -m ground.tuning.lanes_source` writes it anew; a test holds the file to be what this makes. Sixteen lanes are
innermost, at offsets known when it is compiled, several operations to a loop: only then does the compiler do them in
the processor's vectors. Written as loops over rows and columns the same takes five times as long.

A covariance is its upper triangle: element (i, j) of lane k is p[(9 i + j) 16 + k], i <= j.
"""

from __future__ import annotations

from pathlib import Path

LANES = 16
STATES, MEASURED = 9, 6
FILE = Path(__file__).with_name("lanes_step.py")
_GRADIENT = ((0, 1, 2), (1, 3, 4), (2, 4, 5))  # of xx, xy, xz, yy, yz, zz, by row and column

_HEAD = '''"""One step of (17) in lanes. GENERATED: change lanes_source.py, then run it as a module."""

import math

from ground.tuning.wide import kernel, wide

LANES = 16
STATES = 9
SIZE = STATES * STATES * LANES
'''


def _at(i: int, j: int) -> str:
    """Where lane k of element (i, j) lies."""
    return f"{(STATES * min(i, j) + max(i, j)) * LANES} + k"


def _row(i: int, j: int) -> str:
    """Where lane k of element (i, j) of a matrix that is not symmetric lies."""
    return f"{(STATES * i + j) * LANES} + k"


def _lane_loop(body: list[str]) -> list[str]:
    return [f"    for k in range({LANES}):", *(f"        {line}" for line in body)]


def _pulls(count: int) -> list[str]:
    return [f"g{i} = g[{i * LANES} + k]" for i in range(count)]


def _pull(axis: int, of: str, first: int) -> str:
    """Gradient's row times three elements."""
    return " + ".join(f"g{_GRADIENT[axis][c]} * {of}{first + c}" for c in range(3))


def _wanted(i: int, j: int, second_order: bool) -> bool:
    """Whether Phi p Phi' needs element (i, j) of Phi p: Euler takes no velocity below the diagonal."""
    return second_order or not 3 <= j < i


def _transit(second_order: bool) -> list[str]:
    """p = Phi p Phi', by the rows of Phi, then of its transpose; m holds Phi p but for its last three rows."""
    name = "transit_runge_kutta" if second_order else "transit_euler"
    what = "with the terms of second order" if second_order else "Euler"
    lines = ["", "", "@kernel", f"def {name}(p, m, g, dt_s):", f'    """p = Phi p Phi\', {what}; g: gradient."""']
    lines.append("    wide()")
    if second_order:
        lines.append("    second_s2 = 0.5 * dt_s * dt_s")
    for j in range(STATES):
        body = _pulls(6) + [f"a{i} = p[{_at(i, j)}]" for i in range(STATES)]
        for i in range(3):
            r, v = f"a{i} + dt_s * a{3 + i}", f"a{3 + i} + dt_s * (a{6 + i} + pull)"
            body.append(f"pull = {_pull(i, 'a', 0)}")
            if second_order:
                body.append(f"pull_v = {_pull(i, 'a', 3)}")
                r += f" + second_s2 * (pull + a{6 + i})"
                v += " + second_s2 * pull_v"
            body.append(f"m[{_row(i, j)}] = {r}")
            if _wanted(3 + i, j, second_order):
                body.append(f"m[{_row(3 + i, j)}] = {v}")
        lines += _lane_loop(body)
    for i in range(MEASURED):
        body = _pulls(6) + [f"b{j} = m[{_row(i, j)}]" for j in range(STATES) if _wanted(i, j, second_order)]
        for j in range(3):
            if i > 3 + j:
                continue
            r, v = f"b{j} + dt_s * b{3 + j}", f"b{3 + j} + dt_s * (b{6 + j} + pull)"
            body.append(f"pull = {_pull(j, 'b', 0)}")
            if second_order:
                body.append(f"pull_v = {_pull(j, 'b', 3)}")
                r += f" + second_s2 * (pull + b{6 + j})"
                v += " + second_s2 * pull_v"
            if i <= j:
                body.append(f"p[{_at(i, j)}] = {r}")
            body.append(f"p[{_at(i, 3 + j)}] = {v}")
        body += [f"p[{_at(i, 6 + j)}] = b{6 + j}" for j in range(3)]
        lines += _lane_loop(body)
    return lines


def _update() -> list[str]:
    """Six scalar pseudo-measurements, one after the other, with every element of p read and written once.

    c[h] is row h of p before measurement h. First those rows, each with what the measurements before it take off; then
    all rows from below, each with what is left for it, since a row needs the elements that lie under it as they were.
    """
    lines = ["", "", "@kernel", "def update(p, c, q_r, q_v, q_a, r_m2, v_m2ps2):"]
    lines += [
        '    """Process noise, then pseudo-measurements of position and velocity of these variances; c: scratch."""'
    ]
    lines.append("    wide()")
    for i in range(MEASURED):
        body = [f"x{j} = p[{_at(i, j)}]" for j in range(i, STATES)]
        body[0] += f" + {('q_r', 'q_v')[i // 3]}"
        for h in range(i):
            body.append(f"share = c[{_row(h, i)}] * c[{_row(MEASURED, h)}]")
            body += [f"x{j} -= share * c[{_row(h, j)}]" for j in range(i, STATES)]
        body += [f"c[{_row(i, j)}] = x{j}" for j in range(i, STATES)]
        body.append(f"c[{_row(MEASURED, i)}] = 1.0 / (x{i} + {'r_m2' if i < 3 else 'v_m2ps2'})")
        lines += _lane_loop(body)
    for i in reversed(range(STATES)):
        measured = i < MEASURED
        body = [f"x{j} = {f'c[{_row(i, j)}]' if measured else f'p[{_at(i, j)}]'}" for j in range(i, STATES)]
        if not measured:
            body[0] += " + q_a"
        for h in range(i if measured else 0, MEASURED):
            if not measured:
                body.append(f"share = c[{_row(h, i)}] * c[{_row(MEASURED, h)}]")
                body += [f"x{j} -= share * c[{_row(h, j)}]" for j in range(i, STATES)]
                continue
            body += [f"before = x{h}", f"share = before * c[{_row(MEASURED, h)}]"]
            if h > i:
                body.append(f"c[{_row(h, i)}] = before")
            for j in range(i, STATES):
                other = "before" if j == i else f"x{j}" if h == i else f"c[{_row(h, j)}]"
                body.append(f"x{j} -= share * {other}")
        body += [f"p[{_at(i, j)}] = x{j}" for j in range(i, STATES)]
        lines += _lane_loop(body)
    return lines


def _gravity() -> list[str]:
    """The mean: one Euler step with J2, and the gradient of gravity where it began (as kernels/gravity.py has them)."""
    lines = ["", "", "@kernel", "def move(x, g, pole, mu, j2_m2, dt_s):"]
    lines.append(
        '    """Gradient g at the states x (9 rows), then one step of Euler; j2_m2: J2 times radius squared."""'
    )
    lines += ["    wide()", "    w0, w1, w2 = pole[0], pole[1], pole[2]"]
    body = [f"x{i} = x[{i * LANES} + k]" for i in range(STATES)]
    body += [
        "r2 = x0 * x0 + x1 * x1 + x2 * x2",
        "inverse2 = 1.0 / r2",
        "central = mu * inverse2 * math.sqrt(inverse2)",
        "s = x0 * w0 + x1 * w1 + x2 * w2",
        "c = 1.5 * j2_m2 * central * inverse2",
        "share = s * s * inverse2",
        "radial = c * (5.0 * share - 1.0) - central",
        "rr = (3.0 * central + c * (5.0 - 35.0 * share)) * inverse2",
        "rp = 10.0 * c * s * inverse2",
        "pp = -2.0 * c",
    ]
    body += [f"d{i} = rr * x{i} + rp * w{i}" for i in range(3)] + [f"e{i} = rp * x{i} + pp * w{i}" for i in range(3)]
    for number, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        own = " + radial" if i == j else ""
        body.append(f"g[{number * LANES} + k] = d{i} * x{j} + e{i} * w{j}{own}")
    body += [f"x[{i * LANES} + k] = x{i} + dt_s * x{3 + i}" for i in range(3)]
    body += [
        f"x[{(3 + i) * LANES} + k] = x{3 + i} + dt_s * (radial * x{i} + pp * s * w{i} + x{6 + i})" for i in range(3)
    ]
    return lines + _lane_loop(body)


def render() -> str:
    """The whole file."""
    return "\n".join([_HEAD.rstrip("\n"), *_transit(False), *_transit(True), *_update(), *_gravity()]) + "\n"


if __name__ == "__main__":
    FILE.write_text(render(), encoding="utf-8")
    print(f"{FILE.name}: written")
