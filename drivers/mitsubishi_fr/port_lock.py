"""One program of this machine at a time may use a port, whoever runs it."""

from __future__ import annotations

import errno
import hashlib
import os
import socket


class PortTaken(Exception):
    """Another program of this machine, or another part of this one, has the port."""


def lock_port(port: str) -> socket.socket:
    """Hold a serial port, or a `socket://host:port`, until what is returned is closed or the process ends.

    Raises `PortTaken`. Every name of a device counts as the device: /dev/serial/by-id/... is a link.
    """
    name = port if "://" in port else os.path.realpath(port)
    digest = hashlib.sha256(name.encode()).hexdigest()[:16]
    # A name in Linux' abstract namespace (unix(7)) is no file: nobody can plant one, or a link in its place,
    # none is left behind, and the kernel frees it with the process.
    held = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        held.bind(f"\0rattle-inverter-{digest}")
    except OSError as error:
        held.close()
        if error.errno == errno.EADDRINUSE:
            raise PortTaken from error
        raise
    return held
