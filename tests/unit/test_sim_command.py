"""`python -m hil_sim`: what it prints and how it exits."""

import re
import subprocess
import sys

import pytest

from hil_sim import scenario
from hil_sim.__main__ import main
from hil_sim.fault_kinds import KINDS
from hil_sim.pseudorange_schema import KINDS as SATELLITE_KINDS


def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert names == [
        *(
            "burn_in_outage",
            "crosslink_glonass",
            "crosslink_jump",
            "crosslink_ramp",
            "demo",
            "gnss_faults",
            "graceb_faults",
            "graceb_gaps",
            "graceb_pseudoranges",
            "graceb_real",
            "gracefo_outage",
            "j2_outage",
            "nominal",
            "paper_outage",
        ),
        *("sentinel3a_outage", "single_frequency", "soak", "two_orbits", "unannounced_burn", "velocity_bias"),
    ]


def test_keys_explains_every_key_and_every_kind_of_fault(capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN `keys` THEN each key that `show` can show is there, with its default and a meaning."""
    assert main(["keys"]) == 0
    keys, _, kinds = capsys.readouterr().out.partition("\n\n")
    explained = {line.split()[0]: line for line in keys.splitlines()}
    every = scenario.load(
        "burn_in_outage",
        [
            *("attitude.sigma_rad=0.1", "fault.0.kind=nan", "fault.0.start_s=1"),
            *("command.0.at_s=1", "command.0.command=reset_filter"),
            *("pseudoranges.rate_hz=1.0", 'flight.functions.gnss="gnss"'),
            *("satellite_fault.0.kind=nan", "satellite_fault.0.start_s=1", "satellite_fault.0.duration_s=1"),
            *('flight.functions.crosslink="crosslink"', "crosslink.own=1", "crosslink_fault.0.satellites=[1]"),
            *("crosslink_fault.0.start_s=1", "crosslink_fault.0.jump_m=[1.0,0.0,0.0,0.0]"),
        ],
    )
    shown = {re.sub(r"\.\d+\.", ".N.", key) for key in every.origin}
    assert set(explained) == {re.sub(r"(flight\.functions)\..*", r"\1", key) for key in shown}
    for key, line in explained.items():
        meaning = re.split(r"\s{2,}", line, maxsplit=2)[2]
        assert re.search("[a-z]{3}", meaning), key
    assert explained["burn.N.dv_mps"].split()[1] == "required"
    assert explained["gnss.antenna_offset_m"].split("  ")[-1].strip().startswith("body axes")
    assert [kind for kind in (*KINDS, *SATELLITE_KINDS) if f"  {kind} " not in kinds] == []


def test_show_tells_the_origin(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "two_orbits", "--set", "seed=7"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines if line.startswith("seed ")] == [["seed", "7", "--set"]]


@pytest.mark.parametrize(
    "arguments",
    [
        ["show", "nomnal"],
        ["show", "two_orbits", "--set", "gnss.sigma=1"],
        ["run", "two_orbits", "--set", "seed=one"],
        ["show", "absent.toml"],
    ],
)
def test_refusals_take_one_line_and_exit_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("hil_sim: ")
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize("arguments", [[], ["fly"], ["run"], ["show", "two_orbits", "--sett", "seed=1"]])
def test_usage_errors_exit_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert "usage" in capsys.readouterr().err


def test_help_needs_no_simulation_library() -> None:
    """`--help` is there even before the extras are installed."""
    code = "import sys; import hil_sim.__main__ as m\ntry: m.main(['--help'])\nexcept SystemExit: pass\n"
    code += "print(sorted({'numpy', 'satkit', 'erfa', 'numba', 'msgspec'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "[]"
