"""From what the operator wrote to the ends of the ground link: addresses, keys, the folder of its memory."""

from __future__ import annotations

import ipaddress
import socket
from pathlib import Path
from typing import Any, NamedTuple

from flightsw.link.access import Access, Ceiling, KeyFile, KeyRefused
from flightsw.link_port import LinkPort, SerialLine, TcpListener, Transport, UdpListener, UdpPeer

FORMS = "udp:HOST:PORT, udpin:[HOST:]PORT, tcpin:[HOST:]PORT or serial:DEVICE:BAUD"
LOOPBACK = "127.0.0.1"
CEILING_FILE = "signature.ceiling"


class LinkRefused(ValueError):
    """A link that flight cannot start with; the text names it and the remedy."""


class LinkOptions(NamedTuple):
    """What the operator said of the link. addresses: as FORMS. state: folder of what outlives a restart."""

    addresses: tuple[str, ...] = ()
    key: Path | None = None
    state: Path | None = None
    bench: bool = False


class OpenedLink(NamedTuple):
    """The port, who may command through it, and the file of the keys."""

    port: LinkPort
    access: Access
    keys: KeyFile | None


def open_ground_link(options: LinkOptions, unix_ns: int) -> OpenedLink:
    """Open all of it; LinkRefused names what cannot be used. unix_ns: log time now."""
    if options.bench and options.key is not None:
        raise LinkRefused("--bench takes unsigned commands, --link-key forbids them; give one of the two")
    if options.key is not None and options.state is None:
        raise LinkRefused("--link-key needs --link-state DIR: what was accepted before a restart must be remembered")
    keys = ceiling = None
    try:
        if options.state is not None:
            options.state.mkdir(parents=True, exist_ok=True)
        if options.key is not None and options.state is not None:
            keys = KeyFile(options.key)
            ceiling = Ceiling(options.state / CEILING_FILE)
    except OSError as error:
        raise LinkRefused(f"--link-state {options.state}: cannot be used ({error.strerror})") from error
    except KeyRefused as error:
        raise LinkRefused(str(error)) from error
    access = Access((lambda: keys.keys) if keys is not None else tuple, ceiling, unix_ns, options.bench)
    access.keep_ahead(unix_ns)
    if ceiling is not None and ceiling.failed:
        raise LinkRefused(
            f"--link-state {options.state}: cannot be written; commands could be replayed after a restart"
        )
    transports: list[Transport] = []
    try:
        for text in options.addresses:
            transports.append(_open(text, options))
    except LinkRefused:
        for transport in transports:
            transport.close()
        raise
    return OpenedLink(LinkPort(transports), access, keys)


def _open(text: str, options: LinkOptions) -> Transport:
    kind, _, rest = text.partition(":")
    if kind == "serial":
        return _serial(text, rest, options.bench)
    host, _, port = rest.rpartition(":")
    if kind not in ("udp", "udpin", "tcpin") or not port.isdecimal() or not 0 <= int(port) < 65536:
        raise LinkRefused(f"--link {text}: write it as {FORMS}")
    if kind == "udp" and (not host or port == "0"):
        raise LinkRefused(f"--link {text}: write it as udp:HOST:PORT, for example udp:127.0.0.1:14550")
    stream = socket.SOCK_STREAM if kind == "tcpin" else socket.SOCK_DGRAM
    family, address = _address(text, host.strip("[]") or LOOPBACK, int(port), stream)
    loopback = ipaddress.ip_address(str(address[0]).partition("%")[0]).is_loopback
    if options.bench and not loopback:
        raise LinkRefused(
            f"--link {text}: --bench takes unsigned commands and is for this machine only; use {LOOPBACK}"
        )
    if kind != "udp" and not loopback and options.key is None:
        raise LinkRefused(f"--link {text}: listens to other machines; give --link-key FILE, or listen on {LOOPBACK}")
    try:
        if kind == "udp":
            return UdpPeer(family, address)
        return (UdpListener if kind == "udpin" else TcpListener)(family, address, options.bench)
    except OSError as error:
        raise LinkRefused(f"--link {text}: cannot be opened ({error.strerror}); name another port") from error


def _address(text: str, host: str, port: int, kind: int) -> tuple[int, tuple[Any, ...]]:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=kind)[0]
    except (OSError, UnicodeError) as error:
        raise LinkRefused(f"--link {text}: no host {host} ({error}); give a known name or an address") from None
    return family, address


def _serial(text: str, rest: str, bench: bool) -> Transport:
    device, _, baud = rest.rpartition(":")
    if not device or not baud.isdecimal():
        raise LinkRefused(f"--link {text}: write it as serial:DEVICE:BAUD, for example serial:/dev/ttyUSB0:57600")
    if bench:
        raise LinkRefused(f"--link {text}: --bench takes unsigned commands and is for loopback only")
    try:
        return SerialLine(device, int(baud))
    except (OSError, ImportError) as error:
        raise LinkRefused(f"--link {text}: cannot be opened ({getattr(error, 'strerror', error)})") from error
