"""A log as arrays: its channels by name, what else it holds as tables, and plots of both."""

from __future__ import annotations

import difflib
import html
import shutil
import weakref
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, fields, replace
from functools import cached_property
from importlib import import_module
from os import PathLike
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Final, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from daq.block import NS_PER_S, Flag, SampleBlock, values_of
from daq.channel import Channel
from daq.errors import ConfigurationError, LogError, RattleError
from daq.log.reader import ROUNDING_S, SURROGATE, LogReader, Origin, late_by_s
from daq.log.records import ClockRecord, Event, Gap, Impact
from rig.files.faults import read_toml

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go
    import xarray as xr

    from rig.report.record import Verdict

_Record = TypeVar("_Record", bound=Event | Gap | Impact | ClockRecord)
_ORIGINS: Final = get_args(Origin)
_SHOWN = 20
_POINTS = 4000
_ROW_PX = 190


class Folder:
    """A temporary folder that is gone with the last that holds this."""

    def __init__(self) -> None:
        self.path = Path(mkdtemp(prefix="rattle-"))
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)


class Records(tuple[_Record, ...]):
    """Events, gaps, impacts or clock records of a log, in the order of the file."""

    def __new__(cls, kind: type[_Record], records: Iterable[_Record], zero_ns: int) -> Records[_Record]:
        """`zero_ns` is the start of recording."""
        made = super().__new__(cls, records)
        made._names, made._zero_ns = [field.name for field in fields(kind)], zero_ns
        return made

    _names: list[str]
    _zero_ns: int

    def to_pandas(self) -> pd.DataFrame:
        """A row for each; `time` in s since the start of recording, as that of the channels, and `utc`."""
        pd = needed("pandas")
        frame = pd.DataFrame([astuple(each) for each in self], columns=self._names)
        stamps = frame.pop("time_ns").astype("int64")
        frame.insert(0, "time", (stamps - self._zero_ns) / NS_PER_S)
        frame["utc"] = pd.to_datetime(stamps, unit="ns", utc=True)
        return frame

    def _repr_html_(self) -> str:
        rows = [[getattr(each, name) for name in self._names] for each in self[:_SHOWN]]
        more = f"<p>{len(self) - _SHOWN} more</p>" if len(self) > _SHOWN else ""
        return table_of(self._names, rows) + more


@dataclass(frozen=True, eq=False)
class Series:
    """One channel of a log: `values` in `unit` at `time`, in s since the start of recording.

    NaN where a sample is missing. NumPy takes it for its values.
    """

    origin: Origin
    channel: Channel
    block: SampleBlock
    zero_s: float = 0.0
    """Of its sample 0, which for a channel with a rate of its own need not be the start of recording."""

    @property
    def name(self) -> str:
        return self.channel.name

    @property
    def unit(self) -> str:
        return self.channel.unit

    @property
    def values(self) -> NDArray[np.floating]:
        """Shape (n,); float32, or float64 for an angle that grows."""
        return self.block.values

    @property
    def time(self) -> NDArray[np.float64]:
        """In s since the start of recording, shape (n,)."""
        return self.block.times_s() + self.zero_s

    @property
    def sample_rate(self) -> float:
        """In Hz, as the device ran."""
        return self.block.sample_rate

    @property
    def flags(self) -> Flag:
        """What is known to be wrong with any of its samples."""
        return self.block.flags

    @property
    def start(self) -> np.datetime64:
        """When the first sample was taken, UTC."""
        return np.datetime64(self.block.time_ns, "ns")

    def __len__(self) -> int:
        return len(self.block)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.values, dtype, copy=copy)

    def to_pandas(self) -> pd.Series[Any]:
        """With the time in s as its index."""
        pd = needed("pandas")
        found = pd.Series(self.values, pd.Index(self.time, name="time"), name=self.name)
        found.attrs["unit"] = self.unit
        return found

    def to_xarray(self) -> xr.DataArray:
        """With the time in s as its coordinate, unit and sensor as attributes."""
        time = ("time", self.time, {"units": "s"})
        array: xr.DataArray = needed("xarray").DataArray(
            self.values, {"time": time}, ["time"], self.name, self._attributes()
        )
        return array

    def plot(self) -> go.Figure:
        """Against time; a long one by its extremes."""
        return _figure([[self]])

    def _is_beside(self, other: Series) -> bool:
        """Whether a sample index is one time in both."""
        return self.sample_rate == other.sample_rate and abs(self.zero_s - other.zero_s) <= ROUNDING_S

    def _attributes(self) -> dict[str, str]:
        return {"units": self.unit, "origin": self.origin, **self.channel.metadata()}

    def __repr__(self) -> str:
        said = f"{len(self)} samples at {self.sample_rate:.10g} Hz"
        return f"<Series {self.origin}/{self.name} [{self.unit}]: {said}>"

    def _repr_html_(self) -> str:
        rms = float(np.sqrt(np.nanmean(np.square(self.values, dtype=np.float64)))) if len(self) else np.nan
        rows = [
            ["unit", self.unit],
            ["samples", f"{len(self)} at {self.sample_rate:.10g} Hz"],
            ["from, to", f"{self.time[0]:.6g} s, {self.time[-1]:.6g} s" if len(self) else ""],
            ["rms", f"{rms:.4g}"],
            ["flags", str(self.flags)],
        ]
        return table_of([self.name, self.origin], rows)


class Channels:
    """The channels of one origin, by name; each is read when it is asked for."""

    def __init__(self, log: Log, origin: Origin, channels: dict[str, Channel]) -> None:
        self._log, self._origin, self._channels = log, origin, channels

    def __getitem__(self, name: str) -> Series:
        return self.series([name])[name]

    def __contains__(self, name: object) -> bool:
        return name in self._channels

    def __iter__(self) -> Iterator[str]:
        return iter(self._channels)

    def __len__(self) -> int:
        return len(self._channels)

    def __repr__(self) -> str:
        return f"<{self._origin}: {', '.join(self._channels) or 'nothing'}>"

    def series(
        self, names: Collection[str] | None = None, start: float = 0.0, end: float | None = None
    ) -> dict[str, Series]:
        """Several (default: all that have a sample) between two times in s; raises RattleError."""
        for name in names or ():
            if name not in self._channels:
                raise _absent(self._log.path, name, f"was {self._origin}", self._channels)
        wanted = self.filled(self._channels) if names is None else names
        with LogReader(self._log.path) as log:
            zero_ns = log.zero_ns or 0
            found = log.table(self._origin, wanted, start, end, zero_ns)
        return {
            name: Series(self._origin, self._channels[name], block, late_by_s(block, zero_ns))
            for name, block in found.items()
        }

    def filled(self, names: Collection[str]) -> list[str]:
        """Those of `names` that it has with a sample at least."""
        wanted, seen = {name for name in names if name in self._channels}, set[str]()
        with LogReader(self._log.path) as log:
            for _, block in log.blocks(self._origin, wanted):
                seen |= {block.channel} if len(block) else set()
                if seen == wanted:
                    break
        return [name for name in names if name in seen]

    def to_pandas(
        self, names: Collection[str] | None = None, start: float = 0.0, end: float | None = None
    ) -> pd.DataFrame:
        """A column for each channel, the time in s as index; `attrs["units"]` has their units.

        Without names: those at the times that most have. Raises RattleError for names of several rates
        or starts.
        """
        pd = needed("pandas")
        found = list(self.series(names, start, end).values())
        if not found:
            return pd.DataFrame()
        same = max(([each for each in found if each._is_beside(one)] for one in found), key=len)
        if names is not None and len(same) < len(found):
            told = ", ".join(
                f"{each.name} {each.sample_rate:.10g} Hz from {each.zero_s:.6g} s" for each in found
            )
            raise LogError(
                f"{self._log.path}: a table has one rate and one start, these have several: {told}"
            )
        first, last = (
            min(each.block.first_sample for each in same),
            max(each.block.end_sample for each in same),
        )
        index = pd.Index(np.arange(first, last) / same[0].sample_rate + same[0].zero_s, name="time")
        columns = {each.name: values_of([each.block], first, last, each.values.dtype) for each in same}
        frame = pd.DataFrame(columns, index)
        frame.attrs["units"] = {each.name: each.unit for each in same}
        return frame

    def to_xarray(
        self, names: Collection[str] | None = None, start: float = 0.0, end: float | None = None
    ) -> xr.Dataset:
        """A variable for each channel; those that were not sampled as most were have a `time_2` and so on."""
        found = self.series(names, start, end)
        grids = {name: (each.sample_rate, each.time[:1].tobytes(), len(each)) for name, each in found.items()}
        dimensions = [grid for grid, _ in Counter(grids.values()).most_common()]
        arrays = {}
        for name, each in found.items():
            number = dimensions.index(grids[name])
            arrays[name] = each.to_xarray().rename(time=f"time_{number + 1}") if number else each.to_xarray()
        dataset: xr.Dataset = needed("xarray").Dataset(
            arrays, attrs={"log": str(self._log.path), "origin": self._origin}
        )
        return dataset

    def _repr_html_(self) -> str:
        rows = [[name, each.unit, each.quantity, each.location] for name, each in self._channels.items()]
        return table_of([self._origin, "unit", "quantity", "location"], rows)


def _absent(path: Path, name: str, there: str, known: Collection[str]) -> LogError:
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(known) or 'none'}"
    return LogError(f"{path}: no channel {name!r} {there}; {hint}")


class Log:
    """A log for reading. `log["yoke.force"]` is measured where it was, else predicted, nominal or derived;
    `log.predicted["yoke.force"]` says which.
    """

    def __init__(self, path: str | PathLike[str], kept: object = None) -> None:
        """`kept` has to stay as long as this does."""
        self.path, self._kept = Path(path), kept
        with LogReader(self.path) as log:
            channels = {origin: log.channels(origin) for origin in _ORIGINS}
            self.scenario: str = log.scenario
            """The scenario's TOML text."""
            self.run: dict[str, str] = log.metadata.get("run", {})
            """What the log says of the run: id, start, software, instruments."""
            self.complete: bool = log.complete
            """False for one that a crash left: it is read as far as it goes."""
            self.damage: str = log.damage
            """What is wrong with the file; empty if nothing is."""
            self.until_stop_s: float | None = log.until_stop_s
            """Where a run was stopped before its time, in s: what comes after shows its way to rest."""
        self.measured = Channels(self, "measured", channels["measured"])
        self.predicted = Channels(self, "predicted", channels["predicted"])
        self.nominal = Channels(self, "nominal", channels["nominal"])
        self.derived = Channels(self, "derived", channels["derived"])
        self.surrogate = Channels(self, SURROGATE, channels[SURROGATE])

    @cached_property
    def zero_ns(self) -> int:
        """The start of recording, in ns since 1970."""
        with LogReader(self.path) as log:
            return log.zero_ns or 0

    @cached_property
    def notes(self) -> dict[str, str]:
        """What its scenario notes of the run: operator, specimen, whatever else."""
        try:
            notes = read_toml(self.scenario, "scenario").get("notes")
        except ConfigurationError:  # another program may have written it
            return {}
        return {key: str(value) for key, value in notes.items()} if isinstance(notes, dict) else {}

    @property
    def origins(self) -> dict[Origin, Channels]:
        """What there is of measured, predicted, nominal, derived and, by a network, surrogate."""
        each = (self.measured, self.predicted, self.nominal, self.derived, self.surrogate)
        return {found._origin: found for found in each if found}

    def __getitem__(self, name: str) -> Series:
        for channels in self.origins.values():
            if name in channels:
                return channels[name]
        raise self._absent(name)

    def _absent(self, name: str) -> LogError:
        known = dict.fromkeys(each for channels in self.origins.values() for each in channels)
        return _absent(self.path, name, "is in it", known)

    def __contains__(self, name: object) -> bool:
        return any(name in channels for channels in self.origins.values())

    @cached_property
    def impacts(self) -> Records[Impact]:
        """All impacts by the rule of docs/derived.md; a log that has not counted by it is read for them."""
        from rig.derived.derivation import impacts_of  # with the compiler

        with LogReader(self.path) as log:
            return Records(Impact, impacts_of(log), self.zero_ns)

    @cached_property
    def events(self) -> Records[Event]:
        with LogReader(self.path) as log:
            return Records(Event, log.events(), self.zero_ns)

    @cached_property
    def gaps(self) -> Records[Gap]:
        """Every sample that is missing, and why."""
        with LogReader(self.path) as log:
            return Records(Gap, log.gaps(), self.zero_ns)

    @cached_property
    def clocks(self) -> Records[ClockRecord]:
        """How the clocks of the devices lay."""
        with LogReader(self.path) as log:
            return Records(ClockRecord, log.clocks(), self.zero_ns)

    def to_pandas(
        self, names: Collection[str] | None = None, start: float = 0.0, end: float | None = None
    ) -> pd.DataFrame:
        """What was measured, or where nothing was, predicted; see `Channels.to_pandas`."""
        return self._first.to_pandas(names, start, end)

    def to_xarray(
        self, names: Collection[str] | None = None, start: float = 0.0, end: float | None = None
    ) -> xr.Dataset:
        """What was measured, or where nothing was, predicted; see `Channels.to_xarray`."""
        return self._first.to_xarray(names, start, end)

    @property
    def _first(self) -> Channels:
        return next(iter(self.origins.values()), self.measured)

    def plot(self, *names: str, start: float = 0.0, end: float | None = None) -> go.Figure:
        """Channels (default: those measured, or predicted) below each other, measured over predicted."""
        shown = names or tuple(self._first.filled(self._first))
        for name in shown:
            if name not in self:
                raise self._absent(name)
        drawn = [each.series(each.filled(shown), start, end) for each in self.origins.values()]
        rows = [[series[name] for series in drawn if name in series] for name in shown]
        return _figure([row for row in rows if row])

    @cached_property
    def verdict(self) -> Verdict:
        """Whether it lies within what healthy rigs do (`well`; None: nobody can tell), in `sentences`.

        The first of a scenario takes a while, as standard error tells: healthy rigs are simulated, and kept.
        """
        from rig.diagnosis.health import verdict_on
        from rig.library.run import unguarded_main
        from rig.session.progress import Screen, Terminal

        with unguarded_main():
            return verdict_on(self.path, Screen(Terminal(stderr=True)))

    def report(self, path: str | PathLike[str] | None = None) -> Path:
        """Write the page that `rattle run` writes, by default beside the log; returns where."""
        from rig.report.page import write_report
        from rig.report.record import read_run

        page = self.path.with_suffix(".html") if path is None else Path(path)
        try:
            write_report(replace(read_run(self.path), verdict=self.verdict), page)
        except OSError as error:
            raise RattleError(f"cannot write {page}: {error.strerror}") from error
        return page

    def __repr__(self) -> str:
        said = ", ".join(f"{len(channels)} {origin}" for origin, channels in self.origins.items())
        return f"<Log {self.path}: {said or 'no channels'}{'' if self.complete else '; cut short'}>"

    def _repr_html_(self) -> str:
        names = list(dict.fromkeys(name for channels in self.origins.values() for name in channels))
        units = {name: each.unit for held in self.origins.values() for name, each in held._channels.items()}
        rows = [
            [name, units[name], ", ".join(o for o, held in self.origins.items() if name in held)]
            for name in names
        ]
        cut = "" if self.complete else f" is cut short: {html.escape(self.damage)}"
        return f"<p><b>{html.escape(str(self.path))}</b>{cut}</p>" + table_of(["channel", "unit", "is"], rows)


def needed(package: str) -> Any:
    """A package that not everybody has; raises RattleError without it."""
    try:
        return import_module(package)
    except ImportError as error:
        raise RattleError(f"this takes {package}, which is not installed: pip install {package}") from error


def table_of(names: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table as a notebook shows it."""
    head = "".join(f"<th>{html.escape(name)}</th>" for name in names)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _figure(rows: Sequence[Sequence[Series]]) -> go.Figure:
    """A row of plots for each channel, what was measured below what was predicted."""
    import plotly.graph_objects as go

    from rig.pages.plots import BLUE, Plots, Style
    from rig.pages.words import as_written

    plots = Plots(max(len(rows), 1), 1, _ROW_PX, legend=True)
    for cell, row in enumerate(rows):
        last = cell == len(rows) - 1
        factor, unit = as_written(row[0].unit)
        plots.axes(cell, row[0].name, "time / s" if last else "", unit, share_x_with=0)
        for each in row:
            style = Style(BLUE) if each.origin == "derived" else None
            plots.outline(cell, each.origin, each.time, factor * each.values, style, points=_POINTS)
    drawn = plots.figure("log")
    return go.Figure({"data": drawn.traces, "layout": {**drawn.layout, "height": drawn.height_px}})
