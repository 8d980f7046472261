"""From columns of another program's file to channels of the scenario's rig; nothing is guessed in silence."""

from __future__ import annotations

import dataclasses
import difflib
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from daq.channel import Channel
from daq.errors import LogError
from daq.formats.contents import Column, Contents
from daq.formats.recording import Recording, Stretch, TimeBase, Track
from daq.formats.samples import Samples, Scaled
from rig.files.faults import Faults
from rig.files.quantity import QuantityError, si_value
from rig.files.scenario import Scenario
from rig.rigs import RIGS
from rig.rigs.kind import RigKind


@dataclasses.dataclass(frozen=True, slots=True)
class Answers:
    """What the operator says of a file that does not say it.

    `rename` maps names of the file to the rig's, `units` gives units of columns, `skip` leaves columns out,
    `sample_rates` are in Hz (a column takes the first that its file allows), `started_ns` is the time of the
    first sample or of zero on the file's time axis.
    """

    rename: Mapping[str, str] = dataclasses.field(default_factory=dict)
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    skip: Sequence[str] = ()
    sample_rates: Sequence[float] = ()
    started_ns: int | None = None


def matched_to_rig(
    contents: Contents, scenario: Scenario, answers: Answers, source: str, say: Callable[[str], None]
) -> Recording:
    """Fit columns to the channels of the scenario's rig.

    Raises ConfigurationError with every name, unit, rate and length that does not fit; tells `say` what was
    taken from elsewhere than the file.
    """
    faults = Faults(source)
    columns = [column for column in contents.columns if column.name not in answers.skip]
    _note_unused(contents, answers, faults)
    matching = _Matching(RIGS[scenario.rig], scenario, answers, faults, say)
    matches = [match for column in columns if (match := matching.match(column)) is not None]
    counts = Counter((match.column.origin, match.name) for match in matches)
    for (origin, name), count in counts.items():
        if count > 1:
            theirs = [match.column.name for match in matches if match.name == name]
            faults.add(f"{origin}/{name}", ", ".join(theirs), f"one channel, not {count}")
    # of channels that began together at one rate: with fewer samples, some are lost, nobody knows where
    foreign = [match for match in matches if match.column.stretches is None]
    groups: dict[tuple[float, int | None, float], list[_Match]] = {}
    for match in foreign:
        groups.setdefault((match.sample_rate, match.start_ns, match.column.start_s), []).append(match)
    for group in groups.values():
        lengths = {len(match.column.samples) for match in group}
        if len(lengths) > 1:
            each = ", ".join(f"{match.column.name} {len(match.column.samples)}" for match in group)
            faults.add("samples", each, "as many samples of each channel")
    if not columns and not faults:
        faults.missing("channels", "at least one row of samples")
    faults.raise_if_any()
    tracks = tuple(_track(match) for match in matches)
    if any(match.start_ns is None and match.column.stretches is None for match in matches):
        say("the file has no date: its first sample is put at 1970-01-01 (--started says otherwise)")
    names = {match.column.name: match.name for match in matches}
    rest, gaps = contents.rest, contents.rest.gaps
    if gaps is not None:
        gaps = [dataclasses.replace(gap, channel=names[gap.channel]) for gap in gaps if gap.channel in names]
    impacts = [
        dataclasses.replace(impact, channel=names[impact.channel])
        for impact in rest.impacts
        if impact.channel in names
    ]
    return Recording(tracks, rest.metadata, rest.events, gaps, rest.clocks, impacts)


@dataclasses.dataclass(frozen=True, slots=True)
class _Match:
    """A column with all that it needs to be a channel."""

    column: Column
    name: str
    unit: str
    factor: float
    sample_rate: float
    start_ns: int | None


@dataclasses.dataclass(frozen=True, slots=True)
class _Matching:
    """The rig, the operator's answers, and where faults and remarks go."""

    kind: RigKind
    scenario: Scenario
    answers: Answers
    faults: Faults
    say: Callable[[str], None]

    def match(self, column: Column) -> _Match | None:
        """The column as a channel; None if a fault was noted."""
        name = self._name(column)
        if name is None:
            return None
        unit = self.kind.channels.unit(name) or (column.unit or "" if _is_ours(column) else "")
        factor, rate = self._factor(column, name, unit), self._rate(column)
        if not len(column.samples) and column.stretches is None:
            self.faults.add(column.name, "(empty)", "at least one sample")
            return None
        if factor is None or rate is None:
            return None
        start_ns = column.start_ns
        if self.answers.started_ns is not None:
            start_ns = self.answers.started_ns + round(column.start_s * 1e9)
        return _Match(column, name, unit, factor, rate, start_ns)

    def _name(self, column: Column) -> str | None:
        given = self.answers.rename.get(column.name, column.name)
        if self.kind.channels.unit(given) is not None or (_is_ours(column) and given == column.name):
            return given
        alike = [name for name in self.kind.channels if _plain(name) == _plain(given)]
        if len(alike) == 1 and given == column.name:
            self.say(f"{column.name} is taken for {alike[0]}")
            return alike[0]
        near = difflib.get_close_matches(given, self.kind.channels.told, n=1, cutoff=0.5)
        meant = near[0] if near else "NAME"
        known = "" if near else f": {', '.join(self.kind.channels.told)}"
        self.faults.add(
            "channel",
            given,
            f"a channel of the {self.scenario.rig}{known};"
            f" --rename {column.name!r}={meant}, or --skip {column.name!r}",
        )
        return None

    def _factor(self, column: Column, name: str, unit: str) -> float | None:
        given = self.answers.units.get(column.name, column.unit)
        if given is None:
            self.say(
                f"{name}: the file has no unit; taken to be in {unit}, the rig's (--unit says otherwise)"
            )
            return 1.0
        try:
            factor = 1.0 if given == unit else si_value(f"1 {given}", unit)
        except QuantityError as error:
            self.faults.add(f"{column.name}.unit", given, f"{unit} or a multiple of it ({error})")
            return None
        if factor != 1.0:
            self.say(f"{name}: {given} -> {unit}, times {factor:.10g}")
        return factor

    def _rate(self, column: Column) -> float | None:
        if column.stretches is not None:
            return column.stretches[0].base.sample_rate if column.stretches else 1.0
        wanted, stated = self.answers.sample_rates, column.rate
        assumed = self.scenario.acquisition.sample_rate
        if stated is None and len(wanted) > 1:
            self.faults.missing(
                f"{column.name}.sample_rate", "in the file, or one --sample-rate, not several"
            )
            return None
        if stated is None:
            if wanted:
                return wanted[0]
            self.say(f"{column.name}: the file has no rate; taken to be the scenario's {assumed:g} Hz")
            return assumed
        allowed = [rate for rate in (*wanted, assumed) if stated.allows(rate)]
        if allowed:
            return allowed[0]
        says = f"between {stated.low:.10g} and {stated.high:.10g} Hz, as the file says"
        if len(wanted) == 1:
            self.faults.add(f"{column.name}.sample_rate", wanted[0], says)
        elif not stated.is_sure_over(len(column.samples)):
            self.faults.missing(f"{column.name}.sample_rate", f"{says}: tell it with --sample-rate")
        else:
            return stated.likeliest
        return None


def _is_ours(column: Column) -> bool:
    """Whether a run of rattle's was exported with it: such as an encoder's angle, or what was derived."""
    return column.stretches is not None


def _plain(name: str) -> str:
    """A name as programs write it that have no dots in names."""
    return re.sub(r"[^a-z0-9]", "_", name.lower())


def _note_unused(contents: Contents, answers: Answers, faults: Faults) -> None:
    names = [column.name for column in contents.columns]
    given = (("--skip", answers.skip), ("--rename", answers.rename), ("--unit", answers.units))
    for option, wanted in given:
        for name in wanted:
            if name not in names:
                faults.add(option, name, f"a channel of the file: {', '.join(names) or 'it has none'}")


def _track(match: _Match) -> Track:
    column = match.column
    samples: Samples = column.samples if match.factor == 1.0 else Scaled(column.samples, match.factor)
    stretches = column.stretches
    if stretches is None:
        start_ns = match.start_ns if match.start_ns is not None else round(column.start_s * 1e9)
        stretches = (Stretch(0, len(samples), TimeBase(0, start_ns, match.sample_rate)),)
    channel = Channel.from_metadata(match.name, {**column.details, "unit": match.unit})
    if match.factor != 1.0 and channel.scale is not None:
        channel = dataclasses.replace(channel, scale=channel.scale * match.factor)
    try:
        return Track(column.origin, channel, stretches, samples)
    except LogError as error:
        raise LogError(f"{column.name}: {error}") from error
