"""The way to a gRPC device server: loopback only, and a deadline on every call."""

from __future__ import annotations

import ipaddress
import socket
from collections import namedtuple
from collections.abc import Callable
from typing import Any

import grpc

from daq.errors import ConfigurationError, InstrumentAbsent, InstrumentSilent, Problem

CALL_DEADLINE_S = 2.0
ANSWER_MARGIN_S = 0.5  # a call that waits for samples itself gets this much more than it may wait
SLOW_CALLS = {  # these reserve and program the chassis, or talk to a sensor over one wire
    "TaskControl": 10.0,
    "StartTask": 10.0,
    "CfgSampClkTiming": 10.0,
    "ConfigureTEDS": 10.0,
}


class _CallDetails(
    namedtuple(
        "_CallDetails",
        ("method", "timeout", "metadata", "credentials", "wait_for_ready", "compression"),
    ),
    grpc.ClientCallDetails,
):
    """The details of a call, as gRPC wants them from an interceptor."""


class Deadline(grpc.UnaryUnaryClientInterceptor):
    """Gives every call a deadline; nidaqmx sets none and waits for ever on a server that hangs."""

    def intercept_unary_unary(self, continuation: Callable[..., Any], details: Any, request: Any) -> Any:
        """Pass the call on with its deadline: the request's own `timeout` and a margin, or 2 s."""
        name = str(details.method).rpartition("/")[2]
        wait_s = getattr(request, "timeout", None)
        deadline_s = SLOW_CALLS.get(name, CALL_DEADLINE_S) if wait_s is None else wait_s + ANSWER_MARGIN_S
        timed = _CallDetails(
            details.method,
            deadline_s,
            details.metadata,
            details.credentials,
            details.wait_for_ready,
            getattr(details, "compression", None),
        )
        return continuation(timed, request)


def split_address(address: str) -> tuple[str, int]:
    """Return host and port of `host:port`; ConfigurationError unless it is on this machine.

    The channel is not encrypted and the server asks for no password, so that it may not leave the machine:
    use an SSH tunnel to one elsewhere.
    """
    host, _, port = address.rpartition(":")
    host = host.strip("[]")
    allowed = "host:port on this machine (127.0.0.1, ::1 or localhost): the connection is not protected"
    if not (port.isascii() and port.isdecimal() and 0 < int(port) < 65536 and _is_loopback(host)):
        raise ConfigurationError("bench", [Problem("daq_card.grpc", address, allowed)])
    return host, int(port)


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def connect(instrument: str, address: str) -> Any:
    """Return a ready channel to the device server at `address`.

    Raises `InstrumentAbsent` where nobody listens, `InstrumentSilent` where nobody speaks gRPC within 2 s.
    """
    host, port = split_address(address)
    check = "that the NI gRPC device server runs and daq_card.grpc in the bench file"
    try:
        socket.create_connection((host, port), CALL_DEADLINE_S).close()
    except OSError as error:
        raise InstrumentAbsent(instrument, address, f"nobody answers ({error})", check) from error
    plain = grpc.insecure_channel(address, options=[("grpc.max_receive_message_length", -1)])
    try:
        grpc.channel_ready_future(plain).result(CALL_DEADLINE_S)
    except grpc.FutureTimeoutError as error:
        plain.close()
        what = f"something listens there but does not speak gRPC within {CALL_DEADLINE_S:g} s"
        raise InstrumentSilent(instrument, address, what, check) from error
    except BaseException:
        plain.close()
        raise
    return grpc.intercept_channel(plain, Deadline())
