"""An emulated drive whose parameters are as a bench wants them."""

from __future__ import annotations

import math

from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.emulator.drive import InverterSetup
from drivers.mitsubishi_fr.settings import PARITY_SETTINGS, InverterSettings


def matching_setup(settings: InverterSettings, ramp_s: float) -> InverterSetup:
    """A drive that `settings` find as they should be; from 0 to Pr.20, 60 Hz, and back it takes `ramp_s`."""
    raw = {
        fr.STATION: settings.station,
        fr.BAUDRATE: settings.baudrate // 100,
        fr.PARITY: PARITY_SETTINGS[settings.parity],
        fr.MAXIMUM_FREQUENCY: math.ceil(settings.maximum_hz / fr.MAXIMUM_FREQUENCY.scale),
        fr.ACCELERATION_TIME: fr.ACCELERATION_TIME.raw(ramp_s),
        fr.DECELERATION_TIME: fr.DECELERATION_TIME.raw(ramp_s),
    }
    return InverterSetup({register.number - fr.PARAMETERS: value for register, value in raw.items()})
