"""A port has one user at a time on this machine, and whoever had it leaves nothing behind."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from drivers.mitsubishi_fr.line import PortTaken, lock_port

PORT = "socket://127.0.0.1:1"  # nothing is sent to it
HOLDER = """
import sys, time
from drivers.mitsubishi_fr.line import lock_port
held = lock_port(sys.argv[1])
print("held", flush=True)
time.sleep(1e3)
"""


def test_a_port_is_held_once_until_it_is_given_back() -> None:
    with lock_port(PORT):
        with pytest.raises(PortTaken):
            lock_port(PORT)
        lock_port("socket://127.0.0.1:2").close()
    lock_port(PORT).close()


def test_a_process_that_is_killed_gives_it_back() -> None:
    with subprocess.Popen([sys.executable, "-c", HOLDER, PORT], stdout=subprocess.PIPE, text=True) as holder:  # noqa: S603
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(PortTaken):
            lock_port(PORT)
        holder.kill()
    lock_port(PORT).close()


def test_every_name_of_a_device_is_that_device(tmp_path: Path) -> None:
    device, link = tmp_path / "ttyUSB0", tmp_path / "by-id"
    device.touch()
    link.symlink_to(device)
    with lock_port(str(link)), pytest.raises(PortTaken):
        lock_port(str(device))


def test_no_file_is_needed_or_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A shared folder of temporary files is where others could plant one, or a link in its place."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with lock_port(PORT):
        assert list(tmp_path.iterdir()) == []
