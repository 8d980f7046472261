"""An instrument has one user at a time on this machine, and whoever had it leaves nothing behind."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from daq.errors import InstrumentRefused
from drivers import lock as locks
from drivers.lock import InstrumentLock, Latch, lock

PORT = "socket://127.0.0.1:1"  # nothing is sent to it
HOLDER = """
import sys, time
from drivers import lock
lock.FOLDERS = sys.argv[2],
held = lock.lock("inverter", sys.argv[1])
print("held", flush=True)
time.sleep(1e3)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(locks, "FOLDERS", (str(tmp_path),))
    return tmp_path


def assert_free(address: str = PORT) -> None:
    lock("inverter", address).close()


def test_it_is_held_once_until_it_is_given_back_and_no_file_is_left(folder: Path) -> None:
    with lock("inverter", PORT):
        with pytest.raises(
            InstrumentRefused,
            match=rf"inverter at {PORT}: in use by process {os.getpid()} since 20.*nothing was sent",
        ):
            lock("inverter", PORT)
        assert_free("socket://127.0.0.1:2")
    assert list(folder.iterdir()) == []
    assert_free()


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("TCPIP::localhost::5026::SOCKET", "TCPIP0::127.0.0.1::5026::SOCKET"),
        ("TCPIP::localhost::5025::SOCKET", "TCPIP::127.0.0.1::INSTR"),
        ("TCPIP::127.0.0.1::inst0::INSTR", "TCPIP::127.0.0.1::INSTR"),
        ("TCPIP::127.0.0.1::inst0::INSTR", "TCPIP::localhost::hislip0::INSTR"),
        ("TCPIP::127.0.0.1::hislip0,4880::INSTR", "TCPIP::127.0.0.1::5024::SOCKET"),
        ("TCPIP1::127.0.0.1::5025::SOCKET", "TCPIP::127.0.0.1,111::inst0::INSTR"),
        ("socket://localhost:5020", "socket://127.0.0.1:5020"),
    ],
)
def test_an_instrument_of_two_names_is_one(one: str, other: str) -> None:
    with lock("generator", one), pytest.raises(InstrumentRefused, match="in use by"):
        lock("generator", other)


def test_the_lock_is_where_every_user_of_the_machine_finds_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine, everybodys = folder / "mine", folder / "everybody's"
    for each, mode in ((mine, 0o700), (everybodys, 0o1777)):
        each.mkdir()
        each.chmod(mode)
    monkeypatch.setattr(locks, "FOLDERS", (str(folder / "missing"), str(mine), str(everybodys), str(folder)))
    with lock("inverter", PORT):
        assert [path.parent for path in folder.glob("**/*.lock")] == [everybodys]


def test_what_is_no_name_of_a_host_is_locked_as_it_is_written() -> None:
    with lock("generator", f"TCPIP::{'x' * 300}::5025::SOCKET"):
        pass


def test_two_ports_of_a_serial_server_are_two_instruments() -> None:
    with lock("generator", "TCPIP::127.0.0.1::4001::SOCKET"):
        assert_free("TCPIP::127.0.0.1::4002::SOCKET")


def test_a_process_that_is_killed_gives_it_back(folder: Path) -> None:
    command = [sys.executable, "-c", HOLDER, PORT, str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:  # noqa: S603
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(InstrumentRefused, match=f"in use by process {holder.pid} since"):
            lock("inverter", PORT)
        holder.kill()
    assert_free()
    assert list(folder.iterdir()) == []


def keep(pipe: Connection, held: InstrumentLock) -> None:
    held.sign(", which goes on,")
    pipe.send("kept")
    pipe.recv()
    held.close()


def test_a_process_that_was_given_it_holds_it_until_it_ends_as_well(folder: Path) -> None:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    held = lock("inverter", PORT)
    with ours, theirs:
        process = context.Process(target=keep, args=(theirs, held))
        process.start()
        assert ours.recv() == "kept"
        held.close()
        with pytest.raises(
            InstrumentRefused, match=rf"in use by process {process.pid}, which goes on, since"
        ):
            lock("inverter", PORT)
        ours.send("end")
        process.join()
        assert_free()
    assert list(folder.iterdir()) == []


def test_every_name_of_a_device_is_that_device(tmp_path: Path) -> None:
    device, link = tmp_path / "ttyUSB0", tmp_path / "by-id"
    device.touch()
    link.symlink_to(device)
    with lock("inverter", str(link)), pytest.raises(InstrumentRefused, match="in use"):
        lock("generator", f"ASRL{device}::INSTR")
    with (
        lock("generator", "TCPIP0::localhost::5025::SOCKET"),
        pytest.raises(InstrumentRefused, match="in use"),
    ):
        lock("generator", "tcpip::127.0.0.1::5025::socket")


def test_a_latch_is_met_by_whatever_name_also_where_the_adapter_came_back_as_another_device(
    tmp_path: Path,
) -> None:
    before, after, link = tmp_path / "ttyUSB0", tmp_path / "ttyUSB1", tmp_path / "by-id"
    before.touch()
    link.symlink_to(before)
    seen = Latch("inverter", str(link))
    before.unlink()  # the emergency stop cuts its power
    seen.set("pressed")
    assert Latch("generator", f"ASRL{before}::INSTR").told() == "pressed"
    link.unlink()
    link.symlink_to(after)
    found = Latch("inverter", str(link))
    assert found.told() == "pressed"
    found.set("")
    assert found.told() == ""


def test_a_latch_whose_one_name_cannot_be_kept_is_kept_under_the_other(tmp_path: Path, folder: Path) -> None:
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyUSB0")
    by_id, by_device = (Latch("inverter", str(tmp_path / name)) for name in ("by-id", "ttyUSB0"))
    before = set(folder.iterdir())
    by_id.set("")
    by_device.set("")
    made = set(folder.iterdir()) - before
    by_device.set("of the device")
    (as_written,) = (each for each in made if each.read_text() == "")
    as_written.unlink()
    as_written.mkdir()
    with pytest.raises(InstrumentRefused, match="cannot be set"):
        by_id.set("pressed")
    assert by_device.told() == "pressed"


@pytest.mark.parametrize("planted", ["a link", "a pipe"])
def test_nothing_that_somebody_planted_is_followed(folder: Path, planted: str) -> None:
    with lock("inverter", PORT):
        (path,) = folder.iterdir()
    target = folder / "target"
    target.write_text("theirs")
    path.symlink_to(target) if planted == "a link" else os.mkfifo(path)
    with pytest.raises(InstrumentRefused, match="cannot be locked"):
        lock("inverter", PORT)
    assert target.read_text() == "theirs"
