"""Instruments without encryption are reached on this machine only."""

from __future__ import annotations

from typing import Final

LOOPBACK_HOSTS: Final = ("127.0.0.1", "localhost", "[::1]", "::1")
TUNNEL: Final = "127.0.0.1 (nothing is encrypted; reach other machines by an SSH tunnel)"
_PORTS: Final = range(1, 65536)


def misplaced(address: str) -> str | None:
    """What may stand in place of `host:port`; None where it is on loopback."""
    host, _, port = address.rpartition(":")
    if host not in LOOPBACK_HOSTS:
        return f"{TUNNEL} and a port"
    return None if int(port) in _PORTS else "a port from 1 to 65535"
