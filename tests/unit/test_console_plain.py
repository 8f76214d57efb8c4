"""`ground console --plain` and the command's manners: one line for every mistake, clean imports."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from console_story import OUTAGE_START_S, START_UNIX_S, STOP_S, frames, heard, integrity, write_tlog

from ground.__main__ import main
from ground.console.command import parse_address
from ground.console.link import Received, Statistics
from ground.console.plain import live_lines
from ground.errors import OperatorError


def test_a_log_is_printed_whole_at_its_own_times_with_a_final_verdict(tmp_path: Path, capsys: Any) -> None:
    """GIVEN the story as a .tlog WHEN printed plainly THEN a line for each second, events, exit 0, the verdict."""
    path = write_tlog(tmp_path / "link.tlog")

    assert main(["console", "--plain", "--tlog", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    status = [line for line in lines if " EVENT " not in line and not line.startswith("FINAL")]
    assert len(status) == STOP_S + 1
    assert status[0].startswith("2009-01-01T00:00:00Z NOT READY")
    assert status[OUTAGE_START_S + 100].startswith("2009-01-01T00:06:40Z TRUSTED, COASTING")
    assert sum("FLAG_RAISED" in line for line in lines) == 1
    assert lines[-1].startswith("FINAL 2009-01-01T00:21:40Z TRUSTED, uncertified table: ")
    assert "0 lost, 0 damaged" in lines[-1]
    assert all(line.isprintable() for line in lines)


def test_a_silence_in_the_log_is_shown_as_no_link(tmp_path: Path, capsys: Any) -> None:
    """GIVEN a log with 1000 s missing THEN NO LINK lines and one line for the rest of the silence."""
    path = tmp_path / "link.tlog"
    gap_us = ((START_UNIX_S + 50) * 10**6, (START_UNIX_S + 1050) * 10**6)
    records = [(t, f) for t, f in frames() if not gap_us[0] < t < gap_us[1]]
    path.write_bytes(b"".join(t.to_bytes(8, "big") + f for t, f in records))

    assert main(["console", "--plain", "--tlog", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 5 <= sum("NO LINK" in line for line in lines) <= 10
    assert sum("silent until" in line for line in lines) == 1
    assert "lost" in lines[-1]
    assert "[0 lost" not in lines[-1]


class SilentLink:
    """A live link on a scripted clock: one healthy second, then silence."""

    name, live = "scripted", True

    def __init__(self) -> None:
        self.time_s = 1000.0
        self.statistics = Statistics()
        self._waiting = [Received(1000.2, heard(integrity()))]

    def now_s(self) -> float:
        return self.time_s

    def receive(self) -> list[Received]:
        messages, self._waiting = self._waiting, []
        return messages

    def pause(self, paused: bool) -> None:
        pass

    def finished(self) -> bool:
        return False

    def close(self) -> None:
        pass


def test_live_lines_come_once_a_second_and_ctrl_c_gives_the_last_word() -> None:
    link = SilentLink()

    def sleep(duration_s: float) -> None:
        link.time_s += max(duration_s, 0.01)
        if link.time_s > 1006.5:
            raise KeyboardInterrupt

    lines = list(live_lines(link, sleep))

    assert [line[21:28] for line in lines[:-1]] == ["TRUSTED"] * 3 + ["NO LINK"] * 3
    assert lines[-1].startswith("FINAL")
    assert "NO LINK" in lines[-1]


def mistakes(tmp_path: Path) -> Iterator[tuple[list[str], str]]:
    garbage = tmp_path / "garbage.tlog"
    garbage.write_bytes(bytes(range(256)) * 20)
    empty = tmp_path / "empty.tlog"
    empty.write_bytes(b"")
    yield ["--tlog", str(tmp_path / "absent.tlog"), "--plain"], "cannot be read"
    yield ["--tlog", str(tmp_path), "--plain"], "cannot be read"
    yield ["--tlog", str(garbage), "--plain"], "no MAVLink 2"
    yield ["--tlog", str(empty), "--plain"], "no MAVLink 2"
    yield ["--udp", "nonsense", "--plain"], "give HOST:PORT"
    yield ["--udp", "127.0.0.1:70000", "--plain"], "give HOST:PORT"
    yield ["--udp", "no.such.host.invalid:14550", "--plain"], "cannot listen"
    yield ["--speed", "2", "--plain"], "give --tlog FILE too"
    yield ["--tlog", str(garbage), "--speed", "nan", "--plain"], "--speed nan"
    yield ["--tlog", str(garbage), "--speed", "0", "--plain"], "--speed 0"


def test_every_mistake_is_one_clear_line_and_exit_status_2(tmp_path: Path, capsys: Any) -> None:
    for arguments, says in mistakes(tmp_path):
        assert main(["console", *arguments]) == 2, arguments
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1, err
        assert says in err


def test_without_a_terminal_the_console_says_what_to_add(tmp_path: Path, capsys: Any) -> None:
    assert main(["console", "--tlog", str(write_tlog(tmp_path / "link.tlog", 5))]) == 2
    assert "add --plain" in capsys.readouterr().err


@pytest.mark.parametrize(("text", "parts"), [("127.0.0.1:0", ("127.0.0.1", 0)), ("[::1]:14550", ("::1", 14550))])
def test_addresses(text: str, parts: tuple[str, int]) -> None:
    assert parse_address(text) == parts


@pytest.mark.parametrize("text", ["", ":", "1", "h:", ":1", "h:-1", "h:1x", "h:65536", "h:²"])
def test_addresses_refused(text: str) -> None:
    with pytest.raises(OperatorError, match="HOST:PORT"):
        parse_address(text)


def test_the_console_starts_without_the_heavy_libraries() -> None:
    """GIVEN a fresh interpreter WHEN the whole console is imported THEN neither numba nor matplotlib came along."""
    script = (
        "import sys, ground.__main__, ground.console.command, ground.console.view, ground.console.plain\n"
        "heavy = {'numba', 'matplotlib', 'scipy', 'satkit', 'cantools', 'can'} & set(sys.modules)\n"
        "rooms = {m for m in sys.modules if m.split('.')[0] in ('flightsw', 'hil_sim', 'ground')}\n"
        "alien = {m for m in rooms if m not in ('flightsw', 'ground', 'ground.__main__', 'ground.errors')\n"
        "         and not m.startswith(('flightsw.icd', 'ground.console'))}\n"
        "print(sorted(heavy | alien))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)

    assert done.stdout.strip() == "[]"
