"""The gRPC server around the card, on loopback."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import grpc
from nidaqmx._stubs import nidaqmx_pb2_grpc

from drivers.ni_daq.emulator.servicer import CardServicer
from drivers.ni_daq.emulator.wiring import DaqmxError

CALLS_AT_ONCE = 8  # a read waits in its call; others must get through


class _DaqmxErrors(grpc.ServerInterceptor):
    """Sends a `DaqmxError` the way NI's server does: status UNKNOWN and the code in the trailing metadata."""

    def intercept_service(self, continuation: Callable[..., Any], details: Any) -> Any:
        handler = continuation(details)
        if handler is None or handler.unary_unary is None:
            return handler

        def call(request: Any, context: Any) -> Any:
            try:
                return handler.unary_unary(request, context)
            except DaqmxError as error:
                # From here nidaqmx takes the code of its DaqError.
                context.set_trailing_metadata((("ni-error", str(error.code)),))
                context.abort(grpc.StatusCode.UNKNOWN, str(error))

        return grpc.unary_unary_rpc_method_handler(
            call, handler.request_deserializer, handler.response_serializer
        )


class CardServer:
    """Serves a `CardServicer` on 127.0.0.1."""

    def __init__(self, servicer: CardServicer) -> None:
        self._servicer = servicer
        self._server: Any = None

    def open(self) -> str:
        """Listen on a free port; return `host:port`."""
        self._server = grpc.server(ThreadPoolExecutor(CALLS_AT_ONCE), interceptors=[_DaqmxErrors()])
        nidaqmx_pb2_grpc.add_NiDAQmxServicer_to_server(self._servicer, self._server)
        port = self._server.add_insecure_port("127.0.0.1:0")
        self._server.start()
        return f"127.0.0.1:{port}"

    def close(self) -> None:
        """Stop the tasks, then the server."""
        self._servicer.close()
        self._server.stop(grace=None).wait()
