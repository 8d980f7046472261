"""A function generator of the Agilent 33220A / 33500 command set."""

from __future__ import annotations

import re
import time

from drivers.scpi import settings
from drivers.scpi.instrument import ScpiSource
from drivers.scpi.language import MOVING_S, OUTPUT_OFF, OUTPUT_ON, model_in
from drivers.scpi.settings import GeneratorSettings

KNOWN_MODELS = re.compile(r"33210A|33220A|335\d\d[AB]|336\d\d[AB]")
_WATCHED = (OUTPUT_ON, settings.SINE, settings.FREQUENCY, settings.AMPLITUDE, settings.OFFSET)


class ScpiGenerator(ScpiSource):
    """A `DriveGenerator` over SCPI."""

    def __init__(self, config: GeneratorSettings, off_first: bool = False) -> None:
        watched = [each.command for each in _WATCHED]
        super().__init__(config, watched, off_first)
        self.config = config
        self._amplitude_v = self._offset_v = 0.0
        self._triggered = False

    def known(self, identity: str) -> str:
        return "" if KNOWN_MODELS.fullmatch(model_in(identity)) else "33210A, 33220A, 33500 or 33600"

    def arm_sine(self, frequency_hz: float, amplitude_v: float, offset_v: float, *, triggered: bool) -> None:
        """Reset the generator and prepare a sine; see `DriveGenerator.arm_sine`."""
        self._check_limits(amplitude_v, offset_v)
        self._check_range(settings.FREQUENCY, frequency_hz)
        self._reset()
        # The output first, so that nothing moves; load and unit before amplitudes, which depend on them.
        for choice in (OUTPUT_OFF, settings.SINE, settings.OPEN_CIRCUIT, settings.PEAK_TO_PEAK):
            self._choose(choice)
        self._set(settings.FREQUENCY, frequency_hz)
        self._set(settings.AMPLITUDE, 2.0 * amplitude_v)  # peak to Vpp
        self._set(settings.OFFSET, offset_v)
        self._amplitude_v, self._offset_v, self._triggered = amplitude_v, offset_v, triggered
        if triggered:
            for choice in settings.TRIGGERED_BURST:
                self._choose(choice)
            self._choose_promptly(time.monotonic(), OUTPUT_ON)

    def start(self) -> None:
        asked_s = time.monotonic()
        self._link.hurry(MOVING_S)  # before anything moves
        # A burst of infinite count that waits for its trigger: the sine begins at phase 0 with its full
        # amplitude. Turning the output on lets it begin at whatever phase it has.
        if self._triggered and not self._stopped:
            self._link.write("*TRG", asked_s + MOVING_S)
            self._refuse_on_error("trigger")
        else:
            self._choose_promptly(asked_s, OUTPUT_ON)
        self._refuse_stopped()

    def set_frequency(self, frequency_hz: float) -> None:
        self._set(settings.FREQUENCY, frequency_hz)

    def set_amplitude(self, amplitude_v: float) -> None:
        self._check_limits(amplitude_v, self._offset_v)
        self._set(settings.AMPLITUDE, 2.0 * amplitude_v)
        self._amplitude_v = amplitude_v

    def set_offset(self, offset_v: float) -> None:
        self._check_limits(self._amplitude_v, offset_v)
        self._set(settings.OFFSET, offset_v)
        self._offset_v = offset_v

    def _check_limits(self, amplitude_v: float, offset_v: float) -> None:
        self._check_range(settings.AMPLITUDE, 2.0 * amplitude_v)
        self._check_range(settings.OFFSET, offset_v)
        largest = amplitude_v + abs(offset_v)
        if largest > self.config.maximum_amplitude_v:
            raise self._refused(
                f"amplitude + |offset| = {largest:g} V is above the bench's limit of "
                f"{self.config.maximum_amplitude_v:g} V; nothing was sent",
                check="drive amplitude and the bench's maximum_amplitude",
                code="limit",
            )
