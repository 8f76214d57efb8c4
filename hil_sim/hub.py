"""The sensor bus between processes on a machine without CAN: a hub on loopback that hands every frame to all others."""

from __future__ import annotations

import socket
from typing import Any

LOOPBACK = "127.0.0.1"


def serve(port: int, ready: Any) -> int:
    """Serve until interrupted. port 0: any that is free. ready: called with the port once the hub answers."""
    from can_remote.server import RemoteServer

    server = RemoteServer(LOOPBACK, port, interface="virtual", channel="leonav", fd=True, preserve_timestamps=True)
    server.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    ready(server.server_port)
    try:
        server.serve_forever()
    finally:
        server.server_close()
    return 0
