"""A digital input of a card, read on demand by a task of its own: NI-DAQmx lets one at a time have a line."""

from __future__ import annotations

from typing import Any

import nidaqmx
from nidaqmx.stream_readers import DigitalSingleChannelReader

from drivers.ni_daq import session
from drivers.ni_daq.channels import CardSettings
from drivers.ni_daq.tasks import give_back


class CardLine:
    """A `LineReader`."""

    def __init__(self, card: CardSettings) -> None:
        assert card.stop_line is not None  # noqa: S101 - who has none makes no reader
        self._card, self._line = card, card.stop_line
        self._card_address = card.grpc or "the NI driver of this machine"
        self.address = self._line.at(self._card_address)
        self._channel: Any = None
        self._task: Any = None
        self._reader: Any = None

    def open(self) -> None:
        """Connect and start; raises `InstrumentAbsent`, `InstrumentRefused`."""
        if self._card.grpc is not None:
            self._channel = session.connect("emergency stop", self._card.grpc)
        with session.translated("emergency stop", self.address, f"declaring {self._line.line}"):
            remote = self._channel and nidaqmx.GrpcSessionOptions(self._channel, "")
            self._task = nidaqmx.Task(grpc_options=remote)
            self._task.di_channels.add_di_chan(self._line.line)
            self._task.start()  # once: a reading is then a single call
            self._reader = DigitalSingleChannelReader(self._task.in_stream)

    def heed(self) -> None:
        """Read it; see `LineReader.heed`."""
        with session.translated("emergency stop", self.address, f"reading {self._line.line}"):
            on = self._reader.read_one_sample_one_line(0.0)  # as it is now: nothing to wait for
        self._line.heed(on, self._card_address)

    def close(self) -> None:
        if self._task is not None:
            give_back(self._task)  # or the next run could not have the line
        if self._channel is not None:
            self._channel.close()
