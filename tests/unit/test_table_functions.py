"""Tables of functions beside navigation: built from sets, refused by key, flown where they lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flightsw.app import load_function_tables
from flightsw.icd.table_file import decode
from flightsw.icd.table_schema import GNSS, SCHEMAS
from ground.__main__ import main
from ground.errors import OperatorError
from ground.tables.function_sets import build_function, list_function_sets


def test_a_shipped_set_becomes_a_table_that_flight_loads(tmp_path: Path) -> None:
    """GIVEN every shipped set of the kind WHEN built into a tables folder THEN flight finds and opens it."""
    for name in list_function_sets("gnss"):
        assert main(["table", "build-function", "gnss", name, "--out", str(tmp_path / "gnss.tbl")]) == 0
        (image,) = load_function_tables(tmp_path)
        assert (image.kind, image.set_name) == ("gnss", name)
    assert load_function_tables(tmp_path / "nothing here") == ()


def test_overrides_are_named_in_the_table_and_change_what_they_say() -> None:
    plain = decode(build_function("gnss", "gnss")).values
    other = decode(build_function("gnss", "gnss", {"test.alpha": 0.01, "consistency": "markov"}))
    assert other.set_name == "gnss*"
    changed = {name for name in plain.dtype.names or () if plain[name] != other.values[name]}
    assert changed == {"alpha", "consistency"}
    assert (other.values["alpha"][0], other.values["consistency"][0]) == (0.01, 1)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"alpa": 0.1}, 'did you mean "alpha"'),
        ({"alpha": 2.0}, "outside"),
        ({"exclusion.alpha": 0.1}, r"belongs to section \[test\]"),
        ({"faulty_max": 1.5}, "whole number"),
        ({"rule": "magic"}, "none of greedy, probable"),
    ],
)
def test_a_mistake_is_told_by_key(settings: dict[str, object], told: str) -> None:
    with pytest.raises(OperatorError, match=told):
        build_function("gnss", "gnss", settings)


def test_sets_that_are_none_are_told(tmp_path: Path) -> None:
    """GIVEN a kind, a name, a file or a section that is none THEN each is told with what there is."""
    for kind, name, told in (("sonar", "gnss", "there are: gnss"), ("gnss", "gns", 'did you mean "gnss"')):
        with pytest.raises(OperatorError, match=told):
            build_function(kind, name)
    path = tmp_path / "own.toml"
    for text, told in (
        ("name = ", "not valid TOML"),
        ('description = "x"', "give the set a name"),
        ('name = "x"', "say in one line"),
        ('name = "x"\ndescription = "y"\n[sonar]', "unknown section"),
        ('name = "x"\ndescription = "y"\n[protection]', "p_satellite_gps: missing"),
    ):
        path.write_text(text)
        with pytest.raises(OperatorError, match=told):
            build_function("gnss", path)


def test_the_schema_is_registered_once_with_its_number() -> None:
    assert SCHEMAS["gnss"] is GNSS
    numbers = [schema.number for schema in SCHEMAS.values()]
    assert len(set(numbers)) == len(numbers)
    assert GNSS.number == 5
    assert all(np.isfinite([field.minimum, field.maximum]).all() for field in GNSS.fields)
