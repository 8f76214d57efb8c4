"""World, CAN hub, flight and console as separate processes in real time; the death of one ends all, with its reason.

Where this machine has a CAN interface named vcan0 the bus is that, else a hub on loopback. Flight and console share a
key made for the run, so commands from the console are signed as they would be in space.
"""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from hil_sim import sil
from hil_sim.live import SharedClock
from hil_sim.scenario import LoadedScenario
from hil_sim.tether import tethered

RESTART = 3  # exit status of a flight that the ground has ordered to start again
_START_AHEAD_NS = 500_000_000
_POLL_S = 0.05
_PATIENCE_S = 900.0  # kernels may have to be compiled
_GRACE_S = 5.0
_VCAN = "vcan0"


class Ended(Exception):
    """The demo is over; the text is the one line of reason. `status`: exit status."""

    def __init__(self, reason: str, status: int) -> None:
        super().__init__(reason)
        self.status = status


class Process:
    """A child that writes to a log file, and of which one line is waited for."""

    def __init__(self, name: str, arguments: Sequence[str], folder: Path) -> None:
        self.name = name
        self.log = folder / f"{name}.log"
        self.said: list[str] = []
        self.popen = subprocess.Popen(
            [sys.executable, "-u", "-m", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,  # ctrl-C is for the console and for us
            preexec_fn=tethered(signal.SIGKILL),
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.popen.stdout is not None
        with self.log.open("a", encoding="utf-8") as log:
            for line in self.popen.stdout:
                log.write(line)
                log.flush()
                self.said.append(line.rstrip())
                del self.said[:-200]

    def wait_for(self, text: str) -> str:
        """The line that begins with this, once it is said; Ended where the process dies before, or never says it."""
        end = time.monotonic() + _PATIENCE_S
        while time.monotonic() < end:
            found = next((line for line in self.said if line.startswith(text)), None)
            if found is not None:
                return found.removeprefix(text).strip()
            if self.popen.poll() is not None:
                raise Ended(self.reason(), 1)
            time.sleep(_POLL_S)
        raise Ended(f"{self.name} is not ready after {_PATIENCE_S:.0f} s; see {self.log}", 1)

    def reason(self) -> str:
        """Why it ended, on one line."""
        self._reader.join(1.0)
        status = self.popen.poll()
        how = f"by {signal.Signals(-status).name}" if status is not None and status < 0 else f"with status {status}"
        last = next((line for line in reversed(self.said) if line.strip()), "it said nothing")
        return f"{self.name} has ended {how}: {last} ({self.log})"

    def end(self) -> None:
        """Ask it to end. Not by SIGINT: of a demo that a script has put into the background nobody hears that."""
        if self.popen.poll() is None:
            self.popen.terminate()


def run(
    loaded: LoadedScenario, out: Path, speed: float, plain: bool, settings: Sequence[str], real_time: bool = True
) -> int:
    """Run the demo until the console is left or something dies; returns the exit status.

    real_time: flight asks for SCHED_FIFO and locked memory.
    """
    sil.prepare_folder(out)
    for name in ("hub", "world", "flight"):
        (out / f"{name}.log").unlink(missing_ok=True)
    (out / "clock.json").unlink(missing_ok=True)
    for again in out.glob("restart_*"):
        shutil.rmtree(again, ignore_errors=True)
    sil.build_tables(loaded, out / "tables")
    key = out / "link.key"
    key.unlink(missing_ok=True)
    with os.fdopen(os.open(key, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(secrets.token_hex(32) + "\n")
    processes: dict[str, Process] = {}
    console: subprocess.Popen[bytes] | None = None
    # a terminal that is closed, or an operator's kill, ends all of it as well
    former = {number: signal.signal(number, _told_to_end) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        console = _start(loaded, out, speed, plain, settings, real_time, processes, key)
        return _watch(processes, console, out, key)
    except KeyboardInterrupt:
        print("demo: ended by ctrl-C", file=sys.stderr)
        return 0
    except Ended as ended:
        _end_console(console)
        print(f"demo: {ended}", file=sys.stderr)
        return ended.status
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
        _end_console(console)
        _end_all(processes)


def _told_to_end(number: int, frame: object) -> None:
    raise Ended(f"ended by {signal.Signals(number).name}", 128 + number)


def _start(
    loaded: LoadedScenario,
    out: Path,
    speed: float,
    plain: bool,
    settings: Sequence[str],
    real_time: bool,
    processes: dict[str, Process],
    key: Path,
) -> subprocess.Popen[bytes]:
    bus = f"socketcan:{_VCAN}"
    if not (Path("/sys/class/net") / _VCAN).exists():
        print("demo: starting the bus hub on 127.0.0.1", file=sys.stderr)
        processes["hub"] = Process("hub", ["hil_sim", "hub"], out)
        bus = f"remote:127.0.0.1:{processes['hub'].wait_for('hub: ready')}"
    port = _free_port()
    print("demo: preparing the world, warming flight up", file=sys.stderr)
    more = [word for setting in settings for word in ("--set", setting)]
    scenario = str(loaded.path)
    clock = ["--shared-clock", str(out / "clock.json")]
    processes["world"] = Process("world", ["hil_sim", "world", scenario, "--can", bus, *clock, *more], out)
    processes["flight"] = Process("flight", _flight(out, bus, port, key, real_time), out)
    processes["flight"].wait_for("flightsw: ready")
    counter_ns = int(processes["world"].wait_for("world: ready"))
    SharedClock(time.monotonic_ns() + _START_AHEAD_NS, counter_ns, speed).write(out / "clock.json")
    arguments = ["ground", "console", "--udp", f"127.0.0.1:{port}", "--key", str(key), *(["--plain"] if plain else [])]
    # SIGTERM: it gives the terminal back as it found it
    command = [sys.executable, "-m", *arguments]
    return subprocess.Popen(command, start_new_session=False, preexec_fn=tethered(signal.SIGTERM))


def _flight(out: Path, bus: str, port: int, key: Path, real_time: bool) -> list[str]:
    return [
        *("flightsw", "run", "--can", bus, "--tables", str(out / "tables"), "--out", str(out)),
        *("--link", f"udp:127.0.0.1:{port}", "--link-key", str(key), "--link-state", str(out / "link")),
        *("--table-store", str(out / "store"), "--shared-clock", str(out / "clock.json")),
        *(() if real_time else ("--no-real-time",)),
    ]


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def _watch(processes: dict[str, Process], console: subprocess.Popen[bytes], out: Path, key: Path) -> int:
    restarts = 0
    while True:
        time.sleep(_POLL_S)
        if console.poll() is not None:
            return 0 if console.returncode in (0, 130, -signal.SIGINT) else int(console.returncode)
        for name, process in list(processes.items()):
            status = process.popen.poll()
            if status is None:
                continue
            if name == "flight" and status == RESTART:
                restarts += 1
                assert isinstance(process.popen.args, list)
                words = [str(word) for word in process.popen.args[3:]]
                processes[name] = Process(name, with_logs_in(words, out / f"restart_{restarts}"), out)
                continue
            if name == "world" and status == 0:
                raise Ended("the scenario is over", 0)
            raise Ended(process.reason(), 1)


def with_logs_in(words: Sequence[str], folder: Path) -> list[str]:
    """A flight's arguments with another folder for its logs: those of before a restart are kept."""
    place = list(words).index("--out") + 1
    return [*words[:place], str(folder), *words[place + 1 :]]


def _end_console(console: subprocess.Popen[bytes] | None) -> None:
    if console is None or console.poll() is not None:
        return
    console.terminate()
    try:
        console.wait(_GRACE_S)
    except subprocess.TimeoutExpired:
        console.kill()


def _end_all(processes: dict[str, Process]) -> None:
    for name in ("flight", "world", "hub"):
        if name in processes:
            processes[name].end()
    end = time.monotonic() + _GRACE_S
    for process in processes.values():
        with suppress(subprocess.TimeoutExpired):
            process.popen.wait(max(0.1, end - time.monotonic()))
        if process.popen.poll() is None:
            process.popen.kill()
            process.popen.wait(_GRACE_S)
