"""NI data acquisition through the nidaqmx package: this machine's driver or a gRPC device server."""

from drivers.ni_daq.card import NiDaqCard
from drivers.ni_daq.channels import Amplifier, AntiAliasFilter, CardChannel, CardSettings, Pulses

__all__ = ["Amplifier", "AntiAliasFilter", "CardChannel", "CardSettings", "NiDaqCard", "Pulses"]
