"""The file of a surrogate: a zip that NumPy reads (.npz), with what it says of itself in JSON. No pickle."""

from __future__ import annotations

import dataclasses
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from annotated_types import Ge, Le, Len
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from daq.errors import DAMAGED, ConfigurationError, LogError, Problem, RattleError
from rig.rigs import RIGS
from sim_twin.surrogates.judging import Score
from sim_twin.surrogates.networks import NETWORKS
from sim_twin.surrogates.samples import COLUMNS, SETTINGS, Over
from sim_twin.surrogates.surrogate import Kind, Surrogate

SCHEMA: Final = "rattle.surrogate/1"
_ABOUT = "surrogate.json"
_MOST_BYTES = 64 << 20
_FOREIGN = (zipfile.BadZipFile, zlib.error, struct.error, TypeError, *DAMAGED)
"""What NumPy and its zip file raise on damaged input, and arrays that do not fit each other."""
Finite = Annotated[float, Ge(-1e18), Le(1e18)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid", strict=True))
class _About:
    """What a person may want to read of it: `unzip -p MODEL.npz surrogate.json`."""

    schema: Literal["rattle.surrogate/1"]
    rig: str
    channels: Annotated[list[str], Len(1, 64)]
    over: Over
    network: Kind
    parameters: dict[str, float | int | None]
    trained: dict[str, Annotated[list[Finite], Len(2, 2)]]
    logs: dict[str, str]
    tested: dict[str, dict[str, Annotated[float, Ge(0), Le(1e18)]]]


def save_surrogate(surrogate: Surrogate, path: Path) -> None:
    """Write it; a file that is there already is never changed."""
    network = surrogate.network
    arrays = {name: getattr(network, name) for name in network.fitted}
    about = {
        "schema": SCHEMA,
        "rig": surrogate.rig,
        "channels": list(surrogate.channels),
        "over": surrogate.over,
        "network": surrogate.kind,
        "parameters": network.get_params(),
        "trained": {name: list(ends) for name, ends in surrogate.ranges.items()},
        "logs": dict(surrogate.learnt_from),
        "tested": {name: dataclasses.asdict(score) for name, score in surrogate.tested.items()},
    }
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, mean=surrogate.mean, scale=surrogate.scale, **arrays)
    with zipfile.ZipFile(content, "a") as packed:
        packed.writestr(_ABOUT, json.dumps(about, indent=2, allow_nan=False))
    try:
        with path.open("xb") as file:
            file.write(content.getvalue())
    except FileExistsError as error:
        raise RattleError(f"{path} is there already; remove it or name another") from error
    except OSError as error:
        raise RattleError(f"cannot write {path}: {error.strerror}") from error


def load_surrogate(path: Path, rig: str, channels: Mapping[str, object] | None = None) -> Surrogate:
    """Read one that predicts `rig`, and only such `channels` as are named.

    Raises ConfigurationError where it is of another rig or of other channels, LogError where it is damaged
    or no surrogate at all.
    """
    try:
        with zipfile.ZipFile(path) as packed:
            if sum(each.file_size for each in packed.infolist()) > _MOST_BYTES:
                raise LogError(f"{path}: it would unpack to more than any surrogate")
            about = TypeAdapter(_About).validate_json(packed.read(_ABOUT))
        with np.load(path, allow_pickle=False) as arrays:
            surrogate = _built(about, {name: arrays[name] for name in arrays.files if name != _ABOUT})
    except LogError:
        raise
    except FileNotFoundError as error:
        raise LogError(f"{path}: {error.strerror}") from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise LogError(f"{path}: no surrogate of this version: {where} {first['msg']}") from error
    except _FOREIGN as error:
        raise LogError(f"{path}: damaged, or no surrogate ({error}); train it again") from error
    problems = []
    if surrogate.rig != rig:
        known = "the rig that is asked for" if rig in RIGS else "a rig"
        problems.append(Problem("rig", surrogate.rig, f'"{rig}", {known}'))
    missing = [] if channels is None else [name for name in surrogate.channels if name not in channels]
    if not problems and missing:
        told = ", ".join(channels or ()) or "none"
        problems.append(Problem("channels", ", ".join(missing), f"only what the run has: {told}"))
    if problems:
        raise ConfigurationError(str(path), problems)
    return surrogate


def _built(about: _About, arrays: Mapping[str, NDArray[Any]]) -> Surrogate:
    """Raises ValueError or KeyError where arrays do not fit each other."""
    network = NETWORKS[about.network](**about.parameters)
    numbers = {name: np.asarray(arrays[name], np.float64) for name in ("mean", "scale", *network.fitted)}
    for name, each in numbers.items():
        if not np.isfinite(each).all():
            raise ValueError(f"{name} is not finite")
        if name in network.fitted:
            setattr(network, name, each)
    network.n_features_in_ = len(numbers["mean"])
    surrogate = Surrogate(
        about.rig,
        tuple(about.channels),
        about.over,
        about.network,
        network,
        {name: (low, high) for name, (low, high) in about.trained.items()},
        numbers["mean"],
        numbers["scale"],
        about.logs,
        {name: Score(**score) for name, score in about.tested.items()},
    )
    if not set(SETTINGS) <= set(surrogate.ranges) <= set(COLUMNS):
        raise ValueError("ranges of other inputs")
    middle = np.zeros((2, len(COLUMNS)))
    with np.errstate(all="ignore"):
        said = surrogate.predict(middle)
    if said.shape != (2, len(surrogate.channels)) or not np.isfinite(said).all():
        raise ValueError("arrays that do not fit each other")
    return surrogate
