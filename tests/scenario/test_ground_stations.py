"""Ground stations that are not ours, on a running flight: pymavlink, MAVSDK and MAVProxy, on the bench profile.

MAVSDK and MAVProxy are no dependencies: without them their tests are skipped, but under CI=1 they fail.
    pip install mavsdk==4.1.0; pip install --no-deps MAVProxy==1.8.75 pyserial
"""

from __future__ import annotations

import importlib.util
import math
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from harness import load, save_run_tables
from pymavlink import mavftp, mavutil
from pymavlink.dialects import v20

from flightsw.icd import mavlink as m
from flightsw.link.parameters import OPERATIONAL, TABLE_PARAMETERS

PARAMETERS = len(OPERATIONAL) + len(TABLE_PARAMETERS)
PATIENCE_S = 60.0


class Running(NamedTuple):
    """A flight that listens on UDP and TCP, and sends to a UDP address besides."""

    process: subprocess.Popen[str]
    udp: int
    tcp: int
    sends_to: int
    folder: Path


def free_ports(kinds: tuple[int, ...]) -> list[int]:
    sockets = [socket.socket(socket.AF_INET, kind) for kind in kinds]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("flight")
    save_run_tables(load(), folder / "tables")
    udp, tcp, sends_to = free_ports((socket.SOCK_DGRAM, socket.SOCK_STREAM, socket.SOCK_DGRAM))
    command = [sys.executable, "-m", "flightsw", "run", "--can", "virtual:stations", "--tables", str(folder / "tables")]
    command += ["--link", f"udpin:{udp}", "--link", f"tcpin:{tcp}", "--link", f"udp:127.0.0.1:{sends_to}", "--bench"]
    command += ["--link-state", str(folder / "state"), "--out", str(folder / "run")]
    command += ["--table-store", str(folder / "store")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    said = ""
    while "BENCH PROFILE" not in said:
        said = process.stderr.readline()
        assert said, "flight has ended"
    threading.Thread(target=process.stderr.read, daemon=True).start()
    yield Running(process, udp, tcp, sends_to, folder)
    process.terminate()
    process.wait(20)


@pytest.fixture(params=["udp", "tcp"])
def station(flight: Running, request: pytest.FixtureRequest) -> Iterator[Any]:
    """pymavlink with our dialect, connected."""
    os.environ["MAVLINK20"] = "1"
    # where `ground icd export` tells an operator to copy it
    v20.leonav = sys.modules["pymavlink.dialects.v20.leonav"] = m  # type: ignore[attr-defined]
    address = f"udpout:127.0.0.1:{flight.udp}" if request.param == "udp" else f"tcp:127.0.0.1:{flight.tcp}"
    link = mavutil.mavlink_connection(address, dialect="leonav")
    link.mav.heartbeat_send(m.MAV_TYPE_GCS, m.MAV_AUTOPILOT_INVALID, 0, 0, 0)
    assert link.wait_heartbeat(timeout=PATIENCE_S)
    yield link
    link.close()


def ask(link: Any, send: Callable[[], None], kind: str, wanted: Callable[[Any], bool] = lambda _: True) -> Any:
    """Send until the answer is heard: datagrams may be lost, so may ours."""
    for _ in range(30):
        send()
        end = time.monotonic() + 1.0
        while time.monotonic() < end:
            message = link.recv_match(type=kind, blocking=True, timeout=1.0)
            if message is not None and wanted(message):
                return message
    raise AssertionError(f"no {kind}")


def test_pymavlink_finds_the_vehicle_and_loses_nothing(station: Any) -> None:
    """GIVEN a station with the dialect WHEN it listens for five seconds THEN every kind of telemetry is decoded, and of
    the numbers of the messages none is missing."""
    beat = ask(station, lambda: None, "HEARTBEAT")
    assert (beat.type, beat.autopilot) == (m.MAV_TYPE_SPACECRAFT_ORBITER, m.MAV_AUTOPILOT_GENERIC)
    station.mav_loss = 0
    kinds = set()
    end = time.monotonic() + 7.0
    while time.monotonic() < end:
        message = station.recv_match(blocking=True, timeout=1.0)
        if message is not None:
            kinds.add(message.get_type())
    assert {"LEONAV_NAV_STATE", "LEONAV_INTEGRITY", "LEONAV_LINK", "SYS_STATUS", "SYSTEM_TIME"} <= kinds
    assert {"LEONAV_COUNTERS", "LEONAV_TIME_TO_FLAG", "LEONAV_COVARIANCE", "CURRENT_MODE"} <= kinds
    print(f"{station.mav_count} messages, {station.mav_loss} lost")
    assert station.mav_loss == 0
    assert not [kind for kind in kinds if kind.startswith(("UNKNOWN", "BAD"))]


def test_pymavlink_lists_sets_and_reads_parameters(station: Any, flight: Running) -> None:
    """All are listed, one is set and read back, NaN is refused with the old value, another target is ignored; that it
    was is told as STATUSTEXT, at most once in ten seconds."""
    found: dict[str, float] = {}
    station.mav.param_request_list_send(1, 1)
    end = time.monotonic() + PATIENCE_S
    while len(found) < PARAMETERS and time.monotonic() < end:
        message = station.recv_match(type="PARAM_VALUE", blocking=True, timeout=2.0)
        if message is None:
            station.mav.param_request_list_send(1, 1)
        else:
            assert message.param_count == PARAMETERS
            found[message.param_id] = message.param_value
    assert len(found) == PARAMETERS

    def set_to(value: float, target: int = 1) -> None:
        station.mav.param_set_send(target, 1, b"LNK_REPEAT_S", value, m.MAV_PARAM_TYPE_REAL32)

    def is_ours(message: Any) -> bool:
        return bool(message.param_id == "LNK_REPEAT_S")

    assert ask(station, lambda: set_to(2.5), "PARAM_VALUE", is_ours).param_value == 2.5
    assert ask(station, lambda: set_to(math.nan), "PARAM_VALUE", is_ours).param_value == 2.5
    set_to(7.0, target=9)
    read = ask(station, lambda: station.mav.param_request_read_send(1, 1, b"LNK_REPEAT_S", -1), "PARAM_VALUE", is_ours)
    assert read.param_value == 2.5

    def is_refusal(message: Any) -> bool:
        return "Commands refused" in message.text

    assert ask(station, lambda: set_to(7.0, target=9), "STATUSTEXT", is_refusal).severity == m.MAV_SEVERITY_WARNING
    assert ask(station, lambda: set_to(1.0), "PARAM_VALUE", is_ours).param_value == 1.0


def test_pymavlink_commands_are_acknowledged_and_answered(station: Any) -> None:
    def order(number: int, *values: float) -> Any:
        full = [*values, *[0.0] * (7 - len(values))]
        return ask(
            station,
            lambda: station.mav.command_long_send(1, 1, number, 0, *full),
            "COMMAND_ACK",
            lambda ack: bool(ack.command == number),
        ).result

    assert order(m.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1.0) == m.MAV_RESULT_ACCEPTED
    assert order(m.MAV_CMD_SET_MESSAGE_INTERVAL, m.MAVLINK_MSG_ID_HEARTBEAT, -1.0) == m.MAV_RESULT_DENIED
    assert order(22) == m.MAV_RESULT_UNSUPPORTED
    synced = ask(station, lambda: station.mav.timesync_send(0, 42), "TIMESYNC", lambda t: bool(t.ts1 == 42))
    assert abs(synced.tc1 / 1e9 - time.time()) < 60.0


def test_pymavlink_transfers_files(station: Any, flight: Running, tmp_path: Path) -> None:
    """GIVEN pymavlink's own FTP client WHEN it lists, downloads and uploads THEN the bytes are those on the disks."""
    client = mavftp.MAVFTP(station, 1, 1)
    listing = client.cmd_list(["/log"])
    assert listing.return_code == 0
    names = (
        {entry.name for entry in listing.directory_listing.values()}
        if isinstance(listing.directory_listing, dict)
        else {entry.name for entry in listing.directory_listing}
    )
    assert {"can.log", "link.tlog", "run.json"} <= names
    got = tmp_path / "got"
    client.cmd_get(["/log/run.json", str(got)])
    assert client.process_ftp_reply("OpenFileRO", timeout=30).return_code == 0
    assert got.read_bytes() == (flight.folder / "run" / "run.json").read_bytes()
    sent = tmp_path / "sent"
    sent.write_bytes(os.urandom(3000))
    client.cmd_put([str(sent), "/upload/sent.bin"])
    assert client.process_ftp_reply("CreateFile", timeout=30).return_code == 0
    assert (flight.folder / "state" / "upload" / "sent.bin").read_bytes() == sent.read_bytes()


def needed(module: str) -> None:
    """Skip where an optional client is not installed; under CI=1 fail."""
    if importlib.util.find_spec(module) is None:
        assert os.environ.get("CI") != "1", f"{module} is not installed"
        pytest.skip(f"{module} is not installed (see the head of this file)")


MAVSDK_PROGRAM = """
import json, sys
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.ftp.ftp import Ftp
from mavsdk.plugins.info.info import Info
from mavsdk.plugins.param.param import Param
from mavsdk.plugins.telemetry.telemetry import Telemetry
sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
sdk.add_any_connection(f"udpin://127.0.0.1:{sys.argv[1]}")
system = sdk.first_autopilot(30.0)
param = Param(system)
said = {"system": system.get_system_id(), "limit": param.get_param_float("T_LIMIT_M")}
param.set_param_float("LNK_REPEAT_S", 3.5)
said["set"] = param.get_param_float("LNK_REPEAT_S")
try:
    param.set_param_float("LNK_REPEAT_S", float("nan"))
    said["nan"] = "taken"
except Exception as error:
    said["nan"] = "refused"
said["after_nan"] = param.get_param_float("LNK_REPEAT_S")
param.set_param_float("LNK_REPEAT_S", 1.0)
said["parameters"] = len(param.get_all_params().float_params)
said["log"] = sorted(entry.name for entry in Ftp(system).list_directory("/log").entries)
version = Info(system).get_version()
said["version"] = [version.flight_sw_major, version.flight_sw_minor, version.flight_sw_patch]
said["health"] = str(Telemetry(system).health())
print("SAID " + json.dumps(said), flush=True)
"""


def test_mavsdk_finds_lists_sets_and_reads(flight: Running) -> None:
    """GIVEN MAVSDK 4 WHEN it connects THEN vehicle, parameters, set and read back, refused NaN, folder and version."""
    needed("mavsdk")
    import json

    done = subprocess.run(
        [sys.executable, "-c", MAVSDK_PROGRAM, str(flight.sends_to)], capture_output=True, text=True, timeout=120
    )
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("SAID ")]
    said = json.loads(line.removeprefix("SAID "))
    assert said.pop("health").startswith("Health(")
    assert said == {
        "system": 1,
        "limit": 2000.0,
        "set": 3.5,
        "nan": "refused",
        "after_nan": 3.5,
        "parameters": PARAMETERS,
        "log": ["can.log", "link.tlog", "run.json"],
        "version": [0, 1, 0],
    }


def test_mavproxy_finds_lists_and_commands(flight: Running, tmp_path: Path) -> None:
    """GIVEN MAVProxy WHEN it connects THEN it detects the vehicle, receives all parameters, sets one, lists a folder,
    and gets its command acknowledged."""
    needed("MAVProxy")
    script = next(
        path for path in (Path(sys.executable).parent / "mavproxy.py", Path(sys.prefix) / "bin" / "mavproxy.py")
        if path.is_file()
    )  # fmt: skip
    modules = "param,ftp,cmdlong,link,misc,mode"
    command = [sys.executable, "-u", str(script), f"--master=udpin:127.0.0.1:{flight.sends_to}", "--mav20"]
    command += ["--streamrate=-1", "--no-state", f"--default-modules={modules}"]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=tmp_path
    )
    assert process.stdin is not None
    assert process.stdout is not None
    heard: list[str] = []
    threading.Thread(target=lambda: heard.extend(process.stdout), daemon=True).start()  # type: ignore[arg-type]

    def until(text: str, say: str = "") -> None:
        end = time.monotonic() + PATIENCE_S
        said_s = 0.0
        while not any(text in line for line in heard):
            assert time.monotonic() < end, f"{text} not in {heard}"
            if time.monotonic() - said_s > 3.0:  # lines wait in its own buffers until there is more to say
                said_s = time.monotonic()
                process.stdin.write((say or "link list") + "\n")  # type: ignore[union-attr]
                process.stdin.flush()  # type: ignore[union-attr]
            time.sleep(0.05)

    try:
        until("Detected vehicle 1:1")
        until(f"Received {PARAMETERS} parameters")
        until("run.json", "ftp list /log")
        until("REQUEST_AUTOPILOT_CAPABILITIES: ACCEPTED", "long MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES 1")
        until("LNK_REPEAT_S     2.0", "param set LNK_REPEAT_S 2; param show LNK_REPEAT_S")
    finally:
        process.kill()  # it does not end for less while it is being written to
        process.wait(20)
