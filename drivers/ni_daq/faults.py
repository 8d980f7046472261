"""DAQmx and gRPC errors put into the words of rattle."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import grpc
from nidaqmx import errors as nidaqmx_errors
from nidaqmx.error_codes import DAQmxErrors

from daq.errors import (
    DeviceLost,
    InstrumentAbsent,
    InstrumentRefused,
    InstrumentSilent,
    RattleError,
    RecorderFailed,
)

OVERWRITTEN = {
    DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE.value,
    DAQmxErrors.ACQ_STOPPED_TO_PREVENT_INPUT_BUFFER_OVERWRITE.value,
    DAQmxErrors.ACQ_STOPPED_TO_PREVENT_INPUT_BUFFER_OVERWRITE_ONE_DATA_XFER_MECH.value,
    DAQmxErrors.ACQ_STOPPED_TO_PREVENT_INTERMEDIATE_BUFFER_OVERFLOW.value,
    DAQmxErrors.INPUT_FIFO_OVERFLOW.value,
    DAQmxErrors.INPUT_FIFO_OVERFLOW_2.value,
}
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
    if code in OVERWRITTEN:
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
