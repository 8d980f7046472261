"""A Modbus RTU device that this project did not write: pymodbus's own simulator over plain registers."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Mapping

from pymodbus.framer import FramerType
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.mitsubishi_fr.registers import FIRST_NUMBER


class PlainServer:
    """Serves registers (manual number: value) as one station; what is not named is not there."""

    def __init__(self, registers: Mapping[int, int], station: int = 1) -> None:
        self._registers, self._station = dict(registers), station
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._server: ModbusTcpServer
        self.port = ""

    def __enter__(self) -> PlainServer:
        self._thread.start()
        asyncio.run_coroutine_threadsafe(self._begin(), self._loop).result(10.0)
        return self

    def __exit__(self, *exception: object) -> None:
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(10.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _end(self) -> None:
        await self._server.shutdown()  # type: ignore[no-untyped-call]

    async def _begin(self) -> None:
        data = [
            SimData(number - FIRST_NUMBER, values=value, datatype=DataType.REGISTERS)
            for number, value in sorted(self._registers.items())
        ]
        self._server = ModbusTcpServer(
            SimDevice(self._station, data), framer=FramerType.RTU, address=("127.0.0.1", 0)
        )
        await self._server.serve_forever(background=True)
        assert isinstance(self._server.transport, asyncio.Server)
        self.port = f"socket://127.0.0.1:{self._server.transport.sockets[0].getsockname()[1]}"
