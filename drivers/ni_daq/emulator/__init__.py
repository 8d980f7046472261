"""A gRPC device server with an emulated NI 9234 in it, for the unmodified nidaqmx package to talk to."""

from drivers.ni_daq.emulator.process import start_daq_card
from drivers.ni_daq.emulator.wiring import CardWiring, Wire

__all__ = ["CardWiring", "Wire", "start_daq_card"]
