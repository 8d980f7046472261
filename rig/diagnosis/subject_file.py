"""Somebody's own rig: its file, what it makes of what was measured, and what its simulations follow from."""

from __future__ import annotations

import hashlib
import pickle
import sys
import sysconfig
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

import sim_twin
from daq.errors import RattleError
from daq.plugins import plugins
from rig.diagnosis.kept import sources_of
from sim_twin.diagnosis.check import first_draws
from sim_twin.own_rig import Blocks, Columns, OwnRig, Subject

_RATTLE: Final = {"daq", "drivers", "rattle", "rig", "sim_twin", "__main__"}
_INSTALLED: Final = {"site-packages", "dist-packages"}
_BROUGHT: Final = set[str]()
"""Modules that came with a rig: before the next one they are forgotten, as their files may have changed."""


@dataclass(frozen=True)
class ReadRig:
    """A rig, and fingerprints (blocks, numbers) of what was measured on it."""

    subject: Subject
    measured: Blocks

    @cached_property
    def version(self) -> str:
        """A digest of what simulates it: the twin, its modules, and what it shows with each cause.

        That tells of the rest: tables that it reads, other libraries. Raises whatever its code raises.
        """
        digest = hashlib.sha256()
        for package in _packages(self.subject):
            digest.update(sources_of(package).encode())
        for file in sorted(_own_modules().values()):
            with suppress(OSError):  # one of an archive, or that is gone, has to show what it does
                digest.update(Path(file).read_bytes())
        for blocks in chain.from_iterable(self.subject.observe(first_draws(self.subject, 0))):
            digest.update(b"failed" if blocks is None else np.asarray(blocks, np.float32).tobytes())
        return sources_of(sim_twin.__file__)[:32] + digest.hexdigest()[:32]


def read_rig(name: str, tables: Sequence[Columns]) -> ReadRig:
    """What a Python file has as its `SUBJECT`, or an installed package offers under that name, with `tables`.

    Raises RattleError, in words, for what cannot be used.
    """
    own = _own_rig_of(name)
    try:
        subject, measured = own.measured(tables)
    except Exception as error:  # a user's code may raise anything
        raise failed(name, error) from error
    return ReadRig(subject, measured)


def failed(name: str, error: BaseException) -> RattleError:
    """In words, with the last place in the user's own file where there is one."""
    frames = [
        each
        for each in traceback.extract_tb(error.__traceback__)
        if Path(each.filename).name == Path(name).name
    ]
    place = f", line {frames[-1].lineno}" if frames else ""
    return RattleError(f"{name}{place}: {type(error).__name__}: {error}")


def _own_rig_of(name: str) -> OwnRig:
    path = Path(name)
    if path.suffix != ".py":
        offered = plugins("rattle.subjects", object)
        found = offered.found.get(name)
        if found is None:
            known = ", ".join(offered.found) or "none"
            raise RattleError(f"{name} is no Python file, and of installed subjects there is {known}")
    else:
        found = _loaded(path)
    if not isinstance(found, OwnRig):
        raise RattleError(f"{name} has neither a SUBJECT nor a function `measured`; see docs/own_rig.md")
    return found


def _loaded(path: Path) -> object:
    """The file as a module of its name, so that other processes find what is in it; as it is now."""
    if not path.is_file():
        raise RattleError(f"{path}: no such file")
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    for name in _BROUGHT | ({path.stem} & _own_modules().keys()):
        sys.modules.pop(name, None)
    _BROUGHT.clear()
    before = set(sys.modules)
    try:
        module = import_module(path.stem)
    except (Exception, SystemExit) as error:  # it may do anything as it is imported
        raise failed(str(path), error) from error
    finally:
        _BROUGHT.update(_own_modules().keys() - before)
    if Path(str(module.__file__)).resolve() != path.resolve():
        raise RattleError(f"{path}: another module has its name ({module.__file__}); give it another one")
    return getattr(module, "SUBJECT", module)


def _own_modules() -> Mapping[str, str]:
    """Names and files of the modules here that somebody wrote, installed ones apart."""
    files = {name: getattr(module, "__file__", None) for name, module in list(sys.modules.items())}
    return {
        name: file
        for name, file in files.items()
        if name.partition(".")[0] not in _RATTLE and isinstance(file, str) and _is_own(file)
    }


def _is_own(file: str) -> bool:
    return not _INSTALLED & {*Path(file).parts} and not file.startswith(sysconfig.get_path("stdlib"))


def _packages(subject: Subject) -> Iterator[str]:
    """Where the installed packages begin that a subject has something of."""
    named = _Named(pickle.dumps(subject))
    named.load()
    for package in sorted({name.partition(".")[0] for name in named.modules} - _RATTLE):
        file = getattr(sys.modules[package], "__file__", None)
        if isinstance(file, str) and _INSTALLED & {*Path(file).parts}:
            yield file


class _Named(pickle.Unpickler):
    """Notes of which modules something is taken."""

    def __init__(self, content: bytes) -> None:
        super().__init__(BytesIO(content))
        self.modules = set[str]()

    def find_class(self, module: str, name: str) -> Any:
        self.modules.add(module)
        return super().find_class(module, name)
