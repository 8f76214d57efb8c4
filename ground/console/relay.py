"""One feed of flight for several consoles on this machine: every datagram goes to each of them.

Consoles say hello to one of two loopback ports once a second: what they send to the one is passed on to flight, to the
other, where those that only read are, nothing is.
"""

from __future__ import annotations

import selectors
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from ground.console.authentication import Verifier
from ground.console.link import MAX_DATAGRAM, Received, UdpLink, listen

HELLO = b"leonav console"
HELLO_S = 1.0
FORGOTTEN_S = 5.0  # without a hello
CONSOLES = 32  # at a time
_LOOPBACK = "127.0.0.1"
_WAIT_S = 0.5
_AT_ONCE = 200  # datagrams taken from one socket before the others have their turn


class Relay:
    """Passes datagrams on in a thread of its own, from `start` to `close`. Raises OSError where it cannot listen.

    reading, ordering: ports for consoles; None for ordering where nobody may order. refused: datagrams of consoles that
    may not order. clock: seconds that never step back.
    """

    def __init__(self, host: str, port: int, ordering: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.refused = 0
        self._peer: Any = None  # where flight was last heard from
        self._consoles: dict[tuple[int, Any], float] = {}  # by socket and address, when they last said hello
        self._flight = listen(host, port)
        self._sides = [listen(_LOOPBACK, 0) for _ in range(2 if ordering else 1)]
        self.reading: int = self._sides[0].getsockname()[1]
        self.ordering: int | None = self._sides[1].getsockname()[1] if ordering else None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="relay", daemon=True)

    def start(self) -> None:
        """Begin to pass on."""
        self._thread.start()

    def close(self) -> None:
        """End the thread and give the sockets back."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(4 * _WAIT_S)
        for each in (self._flight, *self._sides):
            each.close()

    def _run(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._flight, selectors.EVENT_READ, None)
            for side, its_socket in enumerate(self._sides):
                selector.register(its_socket, selectors.EVENT_READ, side)
            while not self._ended.is_set():
                for ready, _ in selector.select(_WAIT_S):
                    self._take(ready.data)

    def _take(self, side: int | None) -> None:
        its_socket = self._flight if side is None else self._sides[side]
        for _ in range(_AT_ONCE):
            try:
                data, address = its_socket.recvfrom(MAX_DATAGRAM)
            except BlockingIOError:
                return
            except OSError:  # an ICMP error of an earlier datagram; the socket itself stays good
                continue
            if side is None:
                self._peer = address
                self._spread(data)
            elif data == HELLO:
                self._greet(side, address)
            elif side == 1 and (side, address) in self._consoles and self._peer is not None:
                with suppress(OSError):
                    self._flight.sendto(data, self._peer)
            else:
                self.refused += 1

    def _greet(self, side: int, address: Any) -> None:
        now_s = self._clock()
        for each, heard_s in list(self._consoles.items()):
            if now_s - heard_s > FORGOTTEN_S:
                del self._consoles[each]
        if len(self._consoles) < CONSOLES or (side, address) in self._consoles:
            self._consoles[side, address] = now_s

    def _spread(self, data: bytes) -> None:
        for side, address in self._consoles:
            with suppress(OSError):
                self._sides[side].sendto(data, address)


class RelayLink(UdpLink):
    """A console's end of a relay on this machine."""

    def __init__(self, port: int, clock: Callable[[], float], verifier: Verifier | None = None) -> None:
        super().__init__(_LOOPBACK, 0, clock, verifier)
        self.name = f"relay {_LOOPBACK}:{port}"
        self._relay = (_LOOPBACK, port)
        self._greeted_s = -HELLO_S

    def receive(self) -> list[Received]:
        """Say hello when it is time, then as `UdpLink`."""
        now_s = self._clock()
        if not 0.0 <= now_s - self._greeted_s < HELLO_S:
            self._greeted_s = now_s
            with suppress(OSError):
                self._socket.sendto(HELLO, self._relay)
        return super().receive()


class ReadOnly:
    """A link without a way back: a console on it shows everything and orders nothing."""

    live = True

    def __init__(self, link: UdpLink) -> None:
        self._link = link
        self.name = f"{link.name}, read only"
        self.statistics = link.statistics
        self.now_s = link.now_s
        self.receive = link.receive
        self.pause = link.pause
        self.finished = link.finished
        self.close = link.close

    @property
    def forged_s(self) -> float | None:
        """As of the link."""
        return self._link.forged_s

    @property
    def unverified_s(self) -> float | None:
        """As of the link."""
        return self._link.unverified_s
