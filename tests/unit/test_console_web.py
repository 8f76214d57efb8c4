"""`ground console --web`: pages from this machine only, sessions that read, sessions that may order."""

from __future__ import annotations

import asyncio
import os
import re
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("textual_serve", reason="textual-serve (extra web) is not installed")
if sys.platform != "linux":
    pytest.skip("children are counted in /proc", allow_module_level=True)

from aiohttp import WSMsgType, WSServerHandshakeError
from aiohttp.test_utils import TestClient, TestServer, unused_port
from console_story import write_tlog

from ground.__main__ import main
from ground.console.command import _session
from ground.console.web import ConsoleServer, read_token
from ground.errors import OperatorError

TOKEN = "a-token-of-twenty-letters"
PATIENCE_S = 60.0  # for what is there in a moment, but where other work has the processors
ECHO = "python3 -c 'import sys; sys.stdout.write(\"{}\"); sys.stdout.flush(); sys.stdin.read()'"


def with_client(act: Callable[[TestClient[Any, Any]], Awaitable[None]], server: Callable[[int], ConsoleServer]) -> None:
    """Serve on a free port of this machine and act."""

    async def run() -> None:
        port, before = unused_port(), children()
        app = await server(port)._make_app()
        async with TestClient(TestServer(app, port=port, host="127.0.0.1")) as client:
            await act(client)
            # no session outlives its browser
            assert await becomes_true(lambda: children() <= before), f"still running: {children() - before}"

    asyncio.run(run())


def children() -> set[str]:
    """Processes that this one has started and that still run; those of other tests may be among them."""
    return set(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


async def becomes_true(condition: Callable[[], bool]) -> bool:
    end = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < end:
        await asyncio.sleep(0.02)
    return condition()


def echo(port: int) -> ConsoleServer:
    """Sessions that say which of the two commands was run."""
    return ConsoleServer(port, ECHO.format("reading"), ECHO.format("ordering"), TOKEN)


def test_the_page_needs_nothing_from_elsewhere() -> None:
    """GIVEN the page WHEN it is fetched THEN all it names is on this server, and the policy forbids anything else."""

    async def act(client: TestClient[Any, Any]) -> None:
        answer = await client.get("/")
        text = await answer.text()
        assert answer.status == 200
        assert "http://" not in text
        assert "https://" not in text
        assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
        links = re.findall(r'(?:src|href)="(/[^"]+)"|url\("(/[^"]+)"\)', text)
        assert len(links) == 3
        for link in links:
            found = await client.get(link[0] or link[1])
            assert found.status == 200, link

    with_client(act, echo)


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/?token=wrong-token-of-twenty-letters", {}),
        ("/ws/wrong-token-of-twenty-letters", {}),
        ("/", {"Host": "attacker.example"}),
        ("/ws", {"Origin": "http://attacker.example"}),
        (f"/ws/{TOKEN}", {"Origin": "http://attacker.example"}),
    ],
)
def test_strangers_are_refused(path: str, headers: dict[str, str]) -> None:
    async def act(client: TestClient[Any, Any]) -> None:
        if path.startswith("/ws"):
            with pytest.raises(WSServerHandshakeError) as caught:
                await client.ws_connect(path, headers=headers)
            assert caught.value.status == 403
        else:
            assert (await client.get(path, headers=headers)).status == 403

    with_client(act, echo)


@pytest.mark.parametrize(("path", "command"), [("/ws", b"reading"), (f"/ws/{TOKEN}", b"ordering")])
def test_the_token_decides_what_a_session_may(path: str, command: bytes, tmp_path: Path) -> None:
    """GIVEN a server with a token WHEN a session begins THEN the command that is run is the one its address allows."""
    marks = {name: tmp_path / name for name in ("reading", "ordering")}

    def server(port: int) -> ConsoleServer:
        return ConsoleServer(port, f"touch {marks['reading']}", f"touch {marks['ordering']}", TOKEN)

    async def act(client: TestClient[Any, Any]) -> None:
        async with client.ws_connect(path) as session:
            await becomes_true(marks[command.decode()].exists)
            await session.close()

    with_client(act, server)
    assert [name for name, mark in marks.items() if mark.exists()] == [command.decode()]


def test_a_log_is_shown_in_a_browser(tmp_path: Path) -> None:
    """GIVEN a telemetry log WHEN a session is opened THEN the console's screen arrives, with its verdict."""
    log = tmp_path / "link.tlog"
    write_tlog(log, 30)

    def server(port: int) -> ConsoleServer:
        return ConsoleServer(port, _session("--tlog", str(log), "--speed", "100"))

    async def act(client: TestClient[Any, Any]) -> None:
        seen = b""
        async with client.ws_connect("/ws?width=120&height=40") as session:
            while b"TRUSTED" not in seen:
                message = await asyncio.wait_for(session.receive(), PATIENCE_S)
                assert message.type in (WSMsgType.BINARY, WSMsgType.TEXT), seen[-2000:]
                seen += message.data if isinstance(message.data, bytes) else message.data.encode()

    with_client(act, server)


def test_tokens_that_cannot_be_used_are_refused(tmp_path: Path) -> None:
    short, open_to_all = tmp_path / "short", tmp_path / "open"
    short.write_text("short\n")
    short.chmod(0o600)
    open_to_all.write_text(TOKEN)
    open_to_all.chmod(0o644)
    for path, words in ((short, "20 to 200"), (open_to_all, "chmod 600"), (tmp_path / "none", "cannot be read")):
        with pytest.raises(OperatorError, match=words):
            read_token(path)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--web", "0"], "1 to 65535"),
        (["--web", "8765", "--plain"], "leave it out"),
        (["--web", "8765", "--read-only", "--token", "any"], "leave one of them out"),
        (["--web", "8765", "--tlog", "no-such.tlog"], "no such file"),
    ],
)
def test_wrong_arguments(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["console", *arguments]) == 2
    assert words in capsys.readouterr().err
