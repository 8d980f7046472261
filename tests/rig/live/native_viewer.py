"""Rerun's own viewer without a screen, and what can be seen in its pictures."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rerun.experimental import ViewerClient

from rig.live.paths import COLOURS
from rig.live.time_line_process import viewer_environment, viewer_executable

DRAWN_PIXELS = 60
"""A line across a plot has hundreds of pixels of its own colour, a legend's dot under forty."""

has_vulkan = any(Path("/usr/share/vulkan/icd.d").glob("*.json"))
needs_vulkan = pytest.mark.skipif(not has_vulkan, reason="no Vulkan driver (mesa-vulkan-drivers)")


@contextmanager
def viewer(*arguments: str | Path) -> Iterator[ViewerClient]:
    """Rerun's viewer without a screen, itself reachable on loopback only."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    options = ["--headless", "--bind=127.0.0.1", f"--port={port}", "--window-size=1600x1000"]
    process = subprocess.Popen(  # noqa: S603
        [viewer_executable(), *options, *arguments],
        env=viewer_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield connected(f"rerun+http://127.0.0.1:{port}/proxy")
    finally:
        process.kill()
        process.wait()


def connected(url: str) -> ViewerClient:
    deadline = time.monotonic() + 30.0
    while True:
        try:
            client = ViewerClient.connect(url)
            client.get_state()
        except (RuntimeError, ConnectionError):
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)
        else:
            return client


def pixels(picture: Image.Image, colour: tuple[int, int, int]) -> int:
    """How many pixels have the colour, up to the smoothing of edges."""
    distance = np.abs(np.asarray(picture.convert("RGB"), dtype=int) - colour).max(axis=2)
    return int((distance < 40).sum())


def shows(picture: Image.Image, origin: str) -> bool:
    return pixels(picture, COLOURS[origin]) > DRAWN_PIXELS


def shows_both(picture: Image.Image) -> bool:
    return shows(picture, "measured") and shows(picture, "predicted")
