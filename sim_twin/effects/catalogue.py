"""The catalogue of each rig, and its application."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from sim_twin.effects import beam
from sim_twin.effects.effect import Effect, ParameterValues
from sim_twin.effects.sensing import sensing_effects
from sim_twin.rigs.impact_beam.twin import BeamTwin

_FORCES = ("contact.force_upper", "contact.force_lower", "yoke.force")

IMPACT_BEAM: Mapping[str, Effect] = {
    effect.name: effect for effect in (*beam.EFFECTS, *sensing_effects(("drive.force", *_FORCES), _FORCES))
}


def apply_effects(twin: BeamTwin, effects: Iterable[tuple[str, ParameterValues]]) -> BeamTwin:
    """Return `twin` with the named effects in, in the order given.

    Raises ValueError for an effect that the rig cannot have or a parameter outside its range.
    """
    for name, values in effects:
        effect = IMPACT_BEAM.get(name)
        if effect is None:
            raise ValueError(f"no effect {name!r}; known: {', '.join(IMPACT_BEAM)}")
        if not effect.applies(twin):
            raise ValueError(f"{name} does not exist on this rig (the beam is clamped)")
        _check(effect, values)
        twin = effect.change(twin, values)
    return twin


def _check(effect: Effect, values: ParameterValues) -> None:
    expected = {parameter.name for parameter in effect.parameters} | (
        {"channel"} if effect.channels else set()
    )
    if set(values) != expected:
        raise ValueError(
            f"{effect.name} takes exactly {', '.join(sorted(expected))}, not {', '.join(values)}"
        )
    if effect.channels and values["channel"] not in effect.channels:
        raise ValueError(
            f"{effect.name} sits on one of {', '.join(effect.channels)}, not {values['channel']}"
        )
    for parameter in effect.parameters:
        number = float(values[parameter.name])
        if not any(low <= number <= high for low, high in parameter.intervals):
            ranges = " or ".join(f"{low:g} to {high:g}" for low, high in parameter.intervals)
            raise ValueError(
                f"{effect.name}.{parameter.name} = {number:g}: {ranges} {parameter.unit}".rstrip()
            )
