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

from flightsw.kernels.registry import kernel

LANES = 16
STATES = 9
SIZE = STATES * STATES * LANES
'''


def _at(i: int, j: int) -> str:
    """Where lane k of element (i, j) lies."""
    return f"{(STATES * min(i, j) + max(i, j)) * LANES} + k"


def _lane_loop(body: list[str]) -> list[str]:
    return [f"    for k in range({LANES}):", *(f"        {line}" for line in body)]


def _pulls(count: int) -> list[str]:
    return [f"g{i} = g[{i * LANES} + k]" for i in range(count)]


def _pull(axis: int, of: str, first: int) -> str:
    """Gradient's row times three elements."""
    return " + ".join(f"g{_GRADIENT[axis][c]} * {of}{first + c}" for c in range(3))


def _transit(second_order: bool) -> list[str]:
    """p = Phi p Phi', by the rows of Phi, then of its transpose; m holds Phi p but for its last three rows."""
    name = "transit_runge_kutta" if second_order else "transit_euler"
    what = "with the terms of second order" if second_order else "Euler"
    lines = ["", "", "@kernel", f"def {name}(p, m, g, dt_s):", f'    """p = Phi p Phi\', {what}; g: gradient."""']
    if second_order:
        lines.append("    second_s2 = 0.5 * dt_s * dt_s")
    for j in range(STATES):
        body = _pulls(6) + [f"a{i} = p[{_at(i, j)}]" for i in range(STATES)]
        for i in range(3):
            r, v = f"a{i} + dt_s * a{3 + i}", f"a{3 + i} + dt_s * a{6 + i} + dt_s * pull"
            body.append(f"pull = {_pull(i, 'a', 0)}")
            if second_order:
                body.append(f"pull_v = {_pull(i, 'a', 3)}")
                r += f" + second_s2 * (pull + a{6 + i})"
                v += " + second_s2 * pull_v"
            body.append(f"m[{(STATES * i + j) * LANES} + k] = {r}")
            body.append(f"m[{(STATES * (3 + i) + j) * LANES} + k] = {v}")
        lines += _lane_loop(body)
    for i in range(MEASURED):
        body = _pulls(6) + [f"b{j} = m[{(STATES * i + j) * LANES} + k]" for j in range(STATES)]
        for j in range(3):
            if i > 3 + j:
                continue
            r, v = f"b{j} + dt_s * b{3 + j}", f"b{3 + j} + dt_s * b{6 + j} + dt_s * pull"
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
    """Six scalar pseudo-measurements; the state is left alone."""
    lines = ["", "", "@kernel", "def update(p, q_r, q_v, q_a, r_m2, v_m2ps2):"]
    lines.append('    """Process noise, then pseudo-measurements of position and velocity of these variances."""')
    lines += _lane_loop([f"p[{_at(i, i)}] += {('q_r', 'q_v', 'q_a')[i // 3]}" for i in range(STATES)])
    for h in range(MEASURED):
        body = [f"c{i} = p[{_at(h, i)}]" for i in range(STATES)]
        body.append(f"weight = 1.0 / (c{h} + {'r_m2' if h < 3 else 'v_m2ps2'})")
        for i in range(STATES):
            body.append(f"share = c{i} * weight")
            body += [f"p[{_at(i, j)}] -= share * c{j}" for j in range(i, STATES)]
        lines += _lane_loop(body)
    return lines


def render() -> str:
    """The whole file."""
    return "\n".join([_HEAD.rstrip("\n"), *_transit(False), *_transit(True), *_update()]) + "\n"


if __name__ == "__main__":
    FILE.write_text(render(), encoding="utf-8")
    print(f"{FILE.name}: written")
