"""A worker process of an ensemble, from its own side."""

from __future__ import annotations

import multiprocessing
import os
import threading

from rig.rigs import RIGS


def start_worker() -> None:
    """Set up a worker process: it ends when whoever started it is gone, killed or not."""
    threading.Thread(target=_end_with_parent, name="parent watch", daemon=True).start()


def ready() -> bool:
    """The first task of a worker; with the twins imported, so that it is ready when it says so."""
    return all(kind.nominal().model is not None for kind in RIGS.values())


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
