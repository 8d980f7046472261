"""The way to a gRPC device server (loopback only, a deadline on every call), and errors in our own words.

No error of nidaqmx or gRPC leaves `translated`, whether the driver is this machine's or a device server's.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import grpc
import numpy as np
from nidaqmx import errors as nidaqmx_errors
from nidaqmx.error_codes import DAQmxErrors
from numpy.typing import NDArray

from daq.errors import (
    ConfigurationError,
    DeviceLost,
    InstrumentAbsent,
    InstrumentRefused,
    InstrumentSilent,
    Problem,
    RattleError,
    RecorderFailed,
)

# All say that samples are lost for good, in the driver's buffer, on the way to it or in the device.
OVERWRITTEN = {
    DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE.value,
    DAQmxErrors.ACQ_STOPPED_TO_PREVENT_INPUT_BUFFER_OVERWRITE.value,
    DAQmxErrors.ACQ_STOPPED_TO_PREVENT_INPUT_BUFFER_OVERWRITE_ONE_DATA_XFER_MECH.value,
    DAQmxErrors.ACQ_STOPPED_TO_PREVENT_INTERMEDIATE_BUFFER_OVERFLOW.value,
    DAQmxErrors.INPUT_FIFO_OVERFLOW.value,
    DAQmxErrors.INPUT_FIFO_OVERFLOW_2.value,
}
# The device itself; a device server that is gone shows as an error of gRPC.
GONE = {DAQmxErrors.DEV_ABSENT_OR_UNAVAILABLE.value, DAQmxErrors.DEV_CANNOT_BE_ACCESSED.value}
UNSUPPORTED = {
    DAQmxErrors.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT.value,
    DAQmxErrors.ATTR_NOT_SUPPORTED.value,
    DAQmxErrors.SPECIFIED_ATTR_NOT_VALID.value,
}


@contextmanager
def translated(instrument: str, address: str, doing: str) -> Iterator[None]:
    """Let no error of nidaqmx or gRPC out; `doing` says what was being done."""
    try:
        yield
    except nidaqmx_errors.DaqError as error:
        raise _of_daqmx(error, instrument, address, doing) from error
    except nidaqmx_errors.RpcError as error:
        raise _of_grpc(error.rpc_code, str(error), instrument, address, doing) from error
    except nidaqmx_errors.Error as error:  # no NI-DAQmx here, or one too old
        check = "that NI-DAQmx is installed, or name a gRPC device server: daq_card.grpc in the bench file"
        raise InstrumentAbsent(instrument, address, f"{doing}: {_line(error)}", check) from error
    except (grpc.RpcError, ValueError) as error:  # ValueError: the channel was closed by another thread
        raise DeviceLost(instrument, address, f"{doing}: {_line(error)}", "cable and power") from error


def _of_daqmx(error: nidaqmx_errors.DaqError, instrument: str, address: str, doing: str) -> RattleError:
    code = error.error_code
    what = f"{doing}: DAQmx {code}, {_line(error)}"
    if code in OVERWRITTEN:  # the reaction of a recorder that lost samples, not that of a lost device
        lost = f"samples were overwritten before they were read (DAQmx {code})"
        return RecorderFailed(f"{instrument} at {address}: {doing}: {lost}")
    if code == DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE.value:
        return InstrumentSilent(instrument, address, what, "that its sample clock runs", str(code))
    if code in GONE:
        return DeviceLost(instrument, address, what, "cable and power of the chassis", str(code))
    return InstrumentRefused(instrument, address, what, code=str(code))


def _of_grpc(status: grpc.StatusCode, text: str, instrument: str, address: str, doing: str) -> RattleError:
    if status == grpc.StatusCode.DEADLINE_EXCEEDED:
        what = f"{doing}: no answer within the deadline"
        return InstrumentSilent(instrument, address, what, "that the device server is not hung", status.name)
    if status == grpc.StatusCode.UNIMPLEMENTED:
        what = f"{doing}: what answers there is no NI device server, or one too old"
        return InstrumentAbsent(instrument, address, what, "daq_card.grpc in the bench file", status.name)
    what = f"{doing}: the device server is gone ({status.name})"
    return DeviceLost(instrument, address, what, "that the NI gRPC device server runs", status.name)


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]


CALL_DEADLINE_S = 2.0  # a server that is stopped in a call answers never: nidaqmx passes no deadline at all
ANSWER_MARGIN_S = 0.2
"""A call that waits for samples itself gets this much more than it may wait: the way from a server on this
machine. With a block and the wait, a card that hangs is known within 0.7 s."""
MARGINS_S = {"ReadDigitalLines": 0.1}
"""Of what waits for nothing and is read again at once: where one answer is late the next may be in time."""
SLOW_CALLS = {  # these reserve and program the chassis, or talk to a sensor over one wire
    "TaskControl": 10.0,
    "StartTask": 10.0,
    "CfgSampClkTiming": 10.0,
    "ConfigureTEDS": 10.0,
}


class Deadline(grpc.UnaryUnaryClientInterceptor):
    """Gives every call a deadline; nidaqmx sets none and waits for ever on a server that hangs."""

    def intercept_unary_unary(self, continuation: Callable[..., Any], details: Any, request: Any) -> Any:
        """Pass the call on with its deadline: the request's own `timeout` and a margin, or 2 s."""
        name = str(details.method).rpartition("/")[2]
        wait_s = getattr(request, "timeout", None)
        margin_s = MARGINS_S.get(name, ANSWER_MARGIN_S)
        deadline_s = SLOW_CALLS.get(name, CALL_DEADLINE_S) if wait_s is None else wait_s + margin_s
        return continuation(details._replace(timeout=deadline_s), request)


def split_address(address: str) -> tuple[str, int]:
    """Return host and port of `host:port`; ConfigurationError unless it is on this machine.

    The channel is not encrypted and the server asks for no password, so that it may not leave the machine:
    use an SSH tunnel to one elsewhere.
    """
    host, _, port = address.rpartition(":")
    host = host.strip("[]")
    allowed = "host:port on this machine (127.0.0.1, ::1 or localhost): the connection is not protected"
    try:
        is_loopback = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        is_loopback = False
    if not (port.isascii() and port.isdecimal() and 0 < int(port) < 65536 and is_loopback):
        raise ConfigurationError("bench", [Problem("daq_card.grpc", address, allowed)])
    return host, int(port)


@cache
def copy_at_once() -> None:
    """Have nidaqmx copy a whole reading at once, not element by element."""
    from nidaqmx import _grpc_interpreter  # slow to import, for those with a device server only

    names = vars(_grpc_interpreter)
    by_element = names.get("_assign_numpy_array")

    def assign(array: NDArray[Any], came: Any) -> None:
        if isinstance(came, bytes) or len(came) != array.size:
            by_element(array, came)
        else:
            array[...] = np.asarray(came).reshape(array.shape)

    names["_assign_numpy_array"] = assign


def connect(instrument: str, address: str) -> Any:
    """Return a ready channel to the device server at `address`.

    Raises `InstrumentAbsent` where nobody listens, `InstrumentSilent` where nobody speaks gRPC within 2 s.
    """
    host, port = split_address(address)
    check = "that the NI gRPC device server runs and daq_card.grpc in the bench file"
    try:
        # gRPC would go on trying where nobody listens: a plain connection tells at once.
        socket.create_connection((host, port), CALL_DEADLINE_S).close()
    except OSError as error:
        raise InstrumentAbsent(instrument, address, f"nobody answers ({error})", check) from error
    # By default gRPC refuses an answer of over 4 MiB.
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
    copy_at_once()
    # Closing the intercepted channel closes the plain one.
    return grpc.intercept_channel(plain, Deadline())
