"""The commands: what cannot be done is refused in one clear line with exit status 2, never with a traceback."""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from harness import load, tables

from flightsw import __main__ as flightsw_command
from flightsw import replay
from ground.tables.build import build_navigation
from ground.tables.earth_orientation import build_earth_orientation
from hil_sim import __main__ as hil_sim_command


@pytest.fixture(scope="module")
def table_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tables")
    start = load().t_start_gps_ns
    (folder / "navigation.tbl").write_bytes(build_navigation("j2"))
    (folder / "earth_orientation.tbl").write_bytes(build_earth_orientation(start, start + 10**13, None))
    return folder


def one_line(text: str, command: str) -> str:
    lines = text.strip().splitlines()
    assert len(lines) == 1, text
    assert lines[0].startswith(f"{command}: ")
    assert "Traceback" not in text
    return lines[0]


def refuse_run(capsys, *arguments: object) -> str:
    assert flightsw_command.main(["run", *map(str, arguments)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    return one_line(captured.err, "flightsw")


def flip(path: Path, place: int) -> None:
    image = bytearray(path.read_bytes())
    image[place] ^= 1
    path.write_bytes(image)


SPOIL = {
    "missing": (lambda p: p.unlink(), "cannot be read"),
    "a folder": (lambda p: (p.unlink(), p.mkdir()), "cannot be read"),
    "empty": (lambda p: p.write_bytes(b""), "refused"),
    "cut short": (lambda p: p.write_bytes(p.read_bytes()[:-5]), "refused"),
    "with a tail": (lambda p: p.write_bytes(p.read_bytes() + b"\0"), "refused"),
    "with a flipped bit": (lambda p: flip(p, 700), "refused"),
    "with another magic": (lambda p: flip(p, 0), "refused"),
    "text": (lambda p: p.write_text("limit_m = 2000\n" * 99), "refused"),
}


@pytest.mark.parametrize("name", ["navigation.tbl", "earth_orientation.tbl"])
@pytest.mark.parametrize("how", SPOIL)
def test_flight_refuses_a_table_that_is_not_one(
    tmp_path: Path, table_folder: Path, capsys, name: str, how: str
) -> None:
    for path in table_folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    spoil, said = SPOIL[how]
    spoil(tmp_path / name)
    line = refuse_run(capsys, "--can", "virtual:spoilt", "--tables", tmp_path)
    assert said in line
    assert str(tmp_path / name) in line


def test_flight_refuses_tables_in_each_others_place(tmp_path: Path, table_folder: Path, capsys) -> None:
    (tmp_path / "navigation.tbl").write_bytes((table_folder / "earth_orientation.tbl").read_bytes())
    (tmp_path / "earth_orientation.tbl").write_bytes((table_folder / "navigation.tbl").read_bytes())
    line = refuse_run(capsys, "--can", "virtual:spoilt", "--tables", tmp_path)
    assert "kind earth_orientation; navigation is needed" in line


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--can", "virtual"], "INTERFACE:CHANNEL"),
        (["--can", "nosuch:can0"], "cannot be opened"),
        (["--can", "socketcan:no_such_device0"], "cannot be opened"),
        (["--can", "virtual:x", "--link", "udp:1"], "udp:HOST:PORT"),
        (["--can", "virtual:x", "--link", "udp:256.1.1.1:5"], "--link"),
        (["--can", "virtual:x", "--out", "/proc/no/such"], "--out"),
    ],
)
def test_flight_refuses_what_it_cannot_open(table_folder: Path, capsys, arguments: list[str], said: str) -> None:
    assert said in refuse_run(capsys, *arguments, "--tables", table_folder)


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["run"],
        ["run", "--can", "virtual:x"],
        ["run", "--can", "virtual:x", "--tables", "t", "--ticks", "0"],
        ["run", "--can", "virtual:x", "--tables", "t", "--ticks", "many"],
        ["replay"],
        ["replay", "a", "b"],
    ],
)
def test_flightsw_refuses_wrong_arguments(capsys, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        flightsw_command.main(arguments)
    assert refused.value.code == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "nominall"], "did you mean"),
        (["run", "no/such.toml"], "no such scenario file"),
        (["run", "two_orbits", "--set", "gnss.sigma_postion_m=3"], "did you mean"),
        (["run", "two_orbits", "--set", "time.duration_s"], "--set"),
        (["run", "two_orbits", "--set", "flight.table_set=nosuch"], "no set named"),
        (["run", "two_orbits", "--set", "flight.table.limit_n=5"], "limit_n"),
        (["run", "two_orbits", "--set", "flight.table.limit_m=-5"], "limit_m"),
        (["run", "two_orbits", "--link", "tcp:1:2"], "udp:HOST:PORT"),
        (["run", "two_orbits", "--link", "udp:256.256.1.1:14550"], "--link"),
        (["run", "two_orbits", "--out", "/proc/no/such"], "--out"),
        (["show", "two_orbits", "--set", "fault=[{kind='nosuch', start_s=5}]"], "no such fault"),
    ],
)
def test_hil_sim_refuses_in_one_line(tmp_path: Path, capsys, arguments: list[str], said: str) -> None:
    if arguments[0] == "run" and "--out" not in arguments:
        arguments = [*arguments, "--out", str(tmp_path / "run")]
    assert hil_sim_command.main(arguments) == 2
    assert said in one_line(capsys.readouterr().err, "hil_sim")


@pytest.mark.parametrize("speed", ["0", "-1", "nan", "inf", "fast", "1e9"])
def test_hil_sim_refuses_an_impossible_speed(capsys, speed: str) -> None:
    with pytest.raises(SystemExit) as refused:
        hil_sim_command.main(["run", "two_orbits", "--speed", speed])
    assert refused.value.code == 2
    assert "from 0.01 to 10000" in capsys.readouterr().err


def test_out_that_is_a_file_is_refused(tmp_path: Path, capsys) -> None:
    path = tmp_path / "file"
    path.write_text("")
    assert hil_sim_command.main(["run", "two_orbits", "--out", str(path)]) == 2
    assert "--out" in one_line(capsys.readouterr().err, "hil_sim")


def test_help_and_refusals_need_no_compiler() -> None:
    """GIVEN --help or a wrong argument THEN numba is never imported."""
    program = (
        "import sys\n"
        "from {package}.__main__ import main\n"
        "try: main({arguments})\n"
        "except SystemExit: pass\n"
        "assert 'numba' not in sys.modules\n"
    )
    for package, arguments in (
        ("flightsw", ["--help"]),
        ("flightsw", ["run"]),
        ("hil_sim", ["--help"]),
        ("hil_sim", ["run", "nosuch"]),
    ):
        text = program.format(package=package, arguments=arguments)
        done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_flight_in_real_time_over_a_bus_of_its_own(tmp_path: Path, table_folder: Path) -> None:
    """GIVEN a bus on which nothing is heard WHEN flight runs 30 ticks of 100 ms THEN it takes 3 s, sends its telemetry,
    leaves logs that replay to the same bytes, exits with 0.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(60.0)
        command = [sys.executable, "-m", "flightsw", "run", "--can", "virtual:quiet", "--tables", str(table_folder)]
        command += [
            "--link",
            f"udp:127.0.0.1:{listener.getsockname()[1]}",
            "--out",
            str(tmp_path / "run"),
            "--ticks",
            "30",
        ]
        environment = {**os.environ, "PYTHONWARNINGS": "error::ResourceWarning"}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 0, done.stderr
        assert "Traceback" not in done.stderr
        assert done.stdout.startswith("flightsw: 30 ticks, ")
        assert listener.recv(4096)[0] == 0xFD
    run = tmp_path / "run"
    lines = (run / "can.log").read_text().splitlines()
    stamps = [float(line.split()[0].strip("()")) for line in lines if " 202##1" in line]
    assert len(stamps) == 30
    assert stamps[-1] - stamps[0] >= 2.85
    assert json.loads((run / "run.json").read_text())["lockstep"] is False
    assert replay.check_versions(run) == []
    assert replay.replay(run, tmp_path / "again") == (30, None, None)


def test_scenarios_of_the_bench_are_those_that_ship() -> None:
    """The bench builds the tables a run would build."""
    navigation, orientation = tables(load())
    assert navigation.kind == "navigation"
    assert orientation.kind == "earth_orientation"
