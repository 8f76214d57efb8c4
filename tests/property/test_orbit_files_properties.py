"""Whatever happens to an orbit file, it is read as the orbit that it was, or refused in one line with its name."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import orbit_writers as write
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hil_sim.errors import DataError
from hil_sim.truth.orbit_files.read import read_orbit
from hil_sim.truth.real_orbit import RealOrbit, differentiate

NS = 1_000_000_000
T0_NS = 14240 * 86400 * NS
RATE = 2.0 * np.pi / 5700.0
TIMES = T0_NS + np.arange(25) * 60 * NS
# what a mutation may move a state by before it must have been noticed: SP3 and CSV print millimetres; where numbers
# have any width, the last digits of one can be lost unseen, but for the velocity's disagreement with the positions
POSITION_M, VELOCITY_MPS, VELOCITY_FREE_MPS = 2e-3, 2e-4, 0.06
FREE_FORMATS = ("orbit.csv", "orbit.oem")
FORMATS = sorted(write.EARTH_FIXED)
few = settings(max_examples=150)


def motion(t_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    angle = RATE * ((t_ns - T0_NS) / 1e9) + 0.3
    c, s = np.cos(angle), np.sin(angle)
    return 6.88e6 * np.stack((c, 0.6 * s, 0.8 * s), axis=1), 6.88e6 * RATE * np.stack((-s, 0.6 * c, 0.8 * c), axis=1)


TEXTS = {name: form(TIMES, *motion(TIMES)) for name, form in write.EARTH_FIXED.items()}


def outcome(name: str, text: str) -> RealOrbit | None:
    """The orbit, or None where it was refused; anything but DataError in one line fails the test."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_text(text, encoding="utf-8")
        try:
            return read_orbit(path)
        except DataError as error:
            said = str(error)
    assert said.startswith(str(path))
    assert "\n" not in said
    return None


def assert_true(name: str, orbit: RealOrbit) -> None:
    """Every sample that was read is one that was written."""
    assert np.isin(orbit.t_gps_ns, TIMES).all()
    r, v = motion(orbit.t_gps_ns)
    assert np.abs(orbit.r_m - r).max() < POSITION_M
    assert np.abs(orbit.v_mps - v).max() < (VELOCITY_FREE_MPS if name in FREE_FORMATS else VELOCITY_MPS)


@few
@given(st.sampled_from(FORMATS), st.data())
def test_a_file_cut_anywhere(name: str, data: st.DataObject) -> None:
    """GIVEN a file that ends early WHEN it is read THEN what is read is true; a number cut in two never passes."""
    text = TEXTS[name]
    orbit = outcome(name, text[: data.draw(st.integers(0, len(text) - 1))])
    if orbit is not None:
        assert_true(name, orbit)


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_cut_within_its_first_words(name: str) -> None:
    """GIVEN a file of a few characters WHEN it is read THEN it is refused by name, whatever its first line promised."""
    for length in range(40):
        assert outcome(name, TEXTS[name][:length]) is None


@few
@given(st.sampled_from(FORMATS), st.data())
def test_a_line_cut_anywhere(name: str, data: st.DataObject) -> None:
    """GIVEN one line that ends early WHEN the file is read THEN what is read is true."""
    lines = TEXTS[name].splitlines()
    at = data.draw(st.integers(0, len(lines) - 1))
    assume(len(lines[at]) > 0)
    lines[at] = lines[at][: data.draw(st.integers(0, len(lines[at]) - 1))]
    orbit = outcome(name, "\n".join(lines) + "\n")
    if orbit is not None:
        assert_true(name, orbit)


@few
@given(st.sampled_from(FORMATS), st.data())
def test_lines_lost_repeated_or_exchanged(name: str, data: st.DataObject) -> None:
    """GIVEN lines that were lost, doubled or swapped WHEN the file is read THEN what is read is true."""
    lines = TEXTS[name].splitlines()
    at, other = (data.draw(st.integers(0, len(lines) - 1)) for _ in range(2))
    what = data.draw(st.sampled_from(["lose", "double", "swap"]))
    if what == "lose":
        del lines[at]
    elif what == "double":
        lines.insert(other, lines[at])
    else:
        lines[at], lines[other] = lines[other], lines[at]
    orbit = outcome(name, "\n".join(lines) + "\n")
    if orbit is not None:
        assert_true(name, orbit)


@few
@given(st.sampled_from(["m/s", "dm/s", "km/s"]), st.sampled_from(["auto", "m/s", "dm/s", "km/s", "derive"]))
def test_a_velocity_is_right_or_refused(written: str, asked: str) -> None:
    """GIVEN velocities in any unit WHEN read by any word THEN right, derived, or refused: never ten times too large."""
    text = write.sp3(TIMES, *motion(TIMES), unit=written)
    with tempfile.TemporaryDirectory() as folder:
        path = write.save(Path(folder) / "x.sp3", text)
        if asked in ("auto", "derive", written):
            orbit = read_orbit(path, velocity_unit=asked)
            assert np.abs(orbit.v_mps - motion(TIMES)[1]).max() < 1e-2
        else:
            with pytest.raises(DataError, match="velocity and differentiated position"):
                read_orbit(path, velocity_unit=asked)


@few
@given(
    st.sampled_from(FORMATS),
    st.sampled_from([1e-3, 0.1, 10.0, 1e3]),
    st.sampled_from([1e-3, 0.1, 1.0, 10.0, 1e3]),
    st.permutations([0, 1, 2]),
)
def test_swapped_units_and_columns(name: str, scale_r: float, scale_v: float, order: list[int]) -> None:
    """GIVEN positions in a wrong unit, whatever the velocities WHEN the file is read THEN it is refused; and a column
    of velocity in another's place is never believed."""
    r, v = motion(TIMES)
    assert outcome(name, write.EARTH_FIXED[name](TIMES, r * scale_r, v * scale_v)) is None
    if order != [0, 1, 2]:
        assert outcome(name, write.EARTH_FIXED[name](TIMES, r, v[:, order])) is None


@few
@given(st.sampled_from(FORMATS), st.text(max_size=300))
def test_any_text_at_all(name: str, text: str) -> None:
    assert outcome(name, text) is None


@given(
    st.lists(st.integers(1, 40), min_size=12, max_size=30),
    st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=9),
)
def test_polynomials_are_differentiated_exactly(steps: list[int], coefficients: list[float]) -> None:
    """GIVEN a polynomial of degree 8 at most at any spacing WHEN it is differentiated THEN its derivative."""
    t = np.cumsum(steps)
    assume(np.diff(t).max() <= 2.5 * np.median(np.diff(t)))
    s = (t - t[0]) / (t[-1] - t[0]) * 2.0 - 1.0
    polynomial = np.polynomial.Polynomial(coefficients)
    x = polynomial(s)[:, None] * np.ones(3)
    slope = polynomial.deriv()(s) * 2.0 / (t[-1] - t[0])
    got = differentiate(T0_NS + t * NS, x)
    assert np.abs(got[:, 1] - slope).max() < 1e-6 * max(1.0, np.abs(slope).max())
