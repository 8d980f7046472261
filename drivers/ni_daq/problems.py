"""What is wrong with the settings of a card by themselves, before it is asked."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

from daq.errors import Problem
from drivers.ni_daq.channels import CardChannel, CardSettings, Pulses
from drivers.ni_daq.kinds import DECODINGS, INPUTS, Kind

_INPUT_WORDS = {"ai": "an analog input (.../ai0)", "ctr": "a counter (.../ctr0)"}
_NUMBERS = {"sensitivity": "above 0", "range": "above 0", "gain": "above 0, in V/C"}
_ONLY_FOR = {
    "gain": "a charge_amplifier",
    "pulses": "a channel on a counter",
    "amplifier": "a charge_amplifier",
}


def problems(settings: CardSettings) -> list[Problem]:
    """Return everything that is wrong, at once."""
    found: list[Problem] = []
    if not settings.channels:
        found.append(Problem("channels", "none", "at least one"))
    elif not any(channel.input == "ai" for channel in settings.channels):
        found.append(Problem("channels", "counters only", "an analog input too, whose clock samples them"))
    for key in ("sample_rate_hz", "buffer_s"):
        if not _positive(getattr(settings, key)):
            found.append(Problem(key, repr(getattr(settings, key)), "above 0"))
    for field in ("name", "physical"):
        counts = Counter(getattr(channel, field) for channel in settings.channels)
        found += [Problem(f"channels.{field}", text, "only once") for text, n in counts.items() if n > 1]
    for channel in settings.channels:
        found += _channel_problems(channel)
    return found


def _channel_problems(channel: CardChannel) -> Iterator[Problem]:
    key = f"channels[{channel.name}]"
    kinds = INPUTS.get(channel.input)
    if kinds is None:
        yield Problem(f"{key}.physical", channel.physical, " or ".join(_INPUT_WORDS.values()))
        return
    kind = kinds.get(channel.kind)
    if kind is None:
        allowed = f"on {_INPUT_WORDS[channel.input]} one of {', '.join(kinds)}"
        yield Problem(f"{key}.kind", channel.kind, allowed)
        return
    if channel.unit not in kind.units:
        yield Problem(f"{key}.unit", channel.unit, f"one of {', '.join(kind.units)}")
    yield from _number_problems(channel, kind, key)
    yield from _pulse_problems(channel, key)
    yield from _stage_problems(channel, key)
    yield from _superfluous(channel, kind, key)


def _number_problems(channel: CardChannel, kind: Kind, key: str) -> Iterator[Problem]:
    if not _positive(channel.excitation_a):
        yield Problem(f"{key}.excitation_a", repr(channel.excitation_a), "above 0")
    for field in kind.needs:
        value = getattr(channel, field)
        if value is None or (field in _NUMBERS and not _positive(value)):
            yield Problem(f"{key}.{field}", repr(value), _NUMBERS.get(field, "pulses of a counter"))


def _pulse_problems(channel: CardChannel, key: str) -> Iterator[Problem]:
    checks: dict[str, tuple[Callable[[Pulses], bool], str]] = {
        "per_revolution": (lambda pulses: pulses.per_revolution >= 1, "at least 1"),
        "decoding": (lambda pulses: pulses.decoding in DECODINGS, "1, 2 or 4"),
        "initial_angle": (
            lambda pulses: 0.0 <= pulses.initial_angle < math.tau,
            "0 to below one turn, in rad",
        ),
    }
    if channel.pulses is None:
        return
    for field, (sound, allowed) in checks.items():
        if not sound(channel.pulses):
            yield Problem(f"{key}.pulses.{field}", repr(getattr(channel.pulses, field)), allowed)


def _stage_problems(channel: CardChannel, key: str) -> Iterator[Problem]:
    for name, stage in channel.stages.items():
        for field in ("corner_hz", "output_v", "order"):
            value: Any = getattr(stage, field, None)
            if value is not None and not _positive(value):
                yield Problem(f"{key}.{name}.{field}", repr(value), "above 0")


def _superfluous(channel: CardChannel, kind: Kind, key: str) -> Iterator[Problem]:
    takes = {*kind.needs, *(("amplifier",) if "gain" in kind.needs else ())}
    for field, only_for in _ONLY_FOR.items():
        if field not in takes and getattr(channel, field) is not None:
            yield Problem(f"{key}.{field}", repr(getattr(channel, field)), f"only for {only_for}")


def _positive(value: float) -> bool:
    return math.isfinite(value) and value > 0.0
