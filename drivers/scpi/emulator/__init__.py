"""A 33220A that is not there, for VISA to talk to on TCP and on a pty."""

from drivers.scpi.emulator.process import GeneratorSetup, start_function_generator

__all__ = ["GeneratorSetup", "start_function_generator"]
