"""The SCPI generator driver against an instrument that answers wrongly."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from pyvisa_py.protocols import rpc

from daq.errors import DeviceLost, InstrumentError, InstrumentRefused, InstrumentSilent
from drivers.scpi.generator import GeneratorSettings, ScpiGenerator
from drivers.scpi.link import ScpiLink
from tests.drivers.scripted import Answer, ScriptedInstrument, healthy
from tests.end_to_end.command import await_true

HUNG_UP = r"it closed the connection|the connection is lost \(.*reset"
"""An end of the connection is read in order, or as a reset where a request was on its way."""


class Echo:
    """Keeps every setting, except those that `wrong` answers instead."""

    def __init__(self, wrong: dict[str, bytes | None]) -> None:
        self.wrong, self.kept = wrong, dict[str, str]()

    def __call__(self, line: str) -> bytes | None:
        if line in self.wrong:
            return self.wrong[line]
        if line.endswith("?") and line[:-1] in self.kept:
            word = {"INF": "9.9E+37", "ON": "1", "OFF": "0"}.get(self.kept[line[:-1]], self.kept[line[:-1]])
            return word.encode() + b"\n"
        if " " in line:
            command, _, value = line.partition(" ")
            self.kept[command] = value
        return healthy(line)


def test_an_off_goes_past_a_thread_that_hangs_in_an_exchange_and_has_the_last_word() -> None:
    with ScriptedInstrument(Echo({})) as instrument:
        driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=instrument.resource))
        driver.open()
        switching = threading.Thread(target=driver.off)

        def hang() -> None:
            with driver._link._turn:
                switching.start()
                await_true("off", lambda: "OUTP OFF" in instrument.lines)
                driver._link.write("OUTP ON")

        hanging = threading.Thread(target=hang)
        hanging.start()
        for each in (hanging, switching):
            each.join()
        assert [line for line in instrument.lines if "OUTP" in line][-4:] == [
            "OUTP OFF",
            "OUTP ON",
            "OUTP OFF",
            "OUTP?",
        ]
        driver.close()


def arm(answer: Answer) -> list[str]:
    with ScriptedInstrument(answer) as instrument:
        driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=instrument.resource, timeout_s=0.4))
        try:
            driver.open()
            driver.arm_sine(20.0, 1.0, 0.5, triggered=True)
            driver.start()
        finally:
            driver.close()
        return instrument.lines


@pytest.mark.parametrize(
    "wrong",
    [{}, {"*IDN?": b"\xff\n"}, {"*IDN?": b""}, {"SYST:ERR?": b'-222,"never empty"\n'}, {"": b"?\n" * 50}],
    ids=["healthy", "garbled", "mute", "endless errors", "chatters"],
)
def test_a_spare_connection_turns_off_before_anything_else(wrong: dict[str, bytes | None]) -> None:
    with ScriptedInstrument(Echo(wrong)) as instrument:
        settings = GeneratorSettings(1.0, 5.0, resource=instrument.resource, timeout_s=0.4)
        driver = ScpiGenerator(settings, off_first=True)
        try:
            driver.open()
            driver.off()
        finally:
            driver.close()
    told = [line for line in instrument.lines if line]
    assert told == ["OUTP OFF", "OUTP OFF", "OUTP?"]  # opened, before it listens; then switched off


def test_the_scripted_instrument_itself_is_good_enough() -> None:
    lines = arm(Echo({}))
    assert lines[-2:] == ["*TRG", "SYST:ERR?"]
    assert lines.index("OUTP:LOAD INF") < lines.index("VOLT 2")


@pytest.mark.parametrize(
    ("wrong", "error", "match"),
    [
        ({"VOLT?": b"+1.0000000000000E+00\n"}, InstrumentRefused, r"amplitude = 2 Vpp reads back \+1\.0"),
        ({"FREQ?": b"nan\n"}, InstrumentRefused, "frequency: not a number"),
        ({"FREQ?": b"9.9E37\n"}, InstrumentRefused, "frequency = 20 Hz reads back 9.9E37"),
        ({"FREQ?": b"#9999999999\n"}, InstrumentRefused, "frequency: not a number"),
        ({"FREQ?": b"\xff\xfe\n"}, InstrumentRefused, "frequency: not a number"),
        ({"FREQ?": b"2" * 100_000 + b"\n"}, InstrumentRefused, "longer than 4096 bytes"),
        ({"OUTP:LOAD?": b"+5.0E+01\n"}, InstrumentRefused, "output load = INF reads back"),
        ({"VOLT:UNIT?": b"VRMS\n"}, InstrumentRefused, "amplitude unit = VPP reads back 'VRMS'"),
        ({"OUTP?": b"what\n"}, InstrumentRefused, "its output is on already .it answers 'what'."),
        (
            {"SYST:ERR?": b'-222,"Data out of range; value clipped"\n'},
            InstrumentRefused,
            "does not end, last -222",
        ),
        ({"SYST:ERR?": b"what?\n"}, InstrumentRefused, "not an entry of an error queue"),
        ({"FREQ?": b""}, InstrumentSilent, "no answer to FREQ\\? within 0.4 s"),
        ({"FREQ?": b"20"}, InstrumentSilent, "no answer to FREQ\\? within 0.4 s"),
        ({"FREQ?": None}, DeviceLost, HUNG_UP),
        ({"*TRG": None}, DeviceLost, HUNG_UP),
        ({"*IDN?": b""}, InstrumentSilent, "no answer to \\*IDN\\?"),
    ],
)
def test_wrong_answer(wrong: dict[str, bytes | None], error: type[InstrumentError], match: str) -> None:
    with pytest.raises(error, match=match) as caught:
        arm(Echo(wrong))
    assert caught.value.instrument == "signal generator"


def test_scpi_error_names_setting_and_code() -> None:
    queue = [b'+0,"No error"\n'] * 3 + [b'-222,"Data out of range"\n', b'-221,"Settings conflict"\n']

    class Errors(Echo):
        def __call__(self, line: str) -> bytes | None:
            if line == "SYST:ERR?" and "VOLT" in self.kept and queue:
                return queue.pop()
            return super().__call__(line)

    with pytest.raises(
        InstrumentRefused, match="amplitude = 2 Vpp: -221 Settings conflict; -222 Data"
    ) as caught:
        arm(Errors({}))
    assert caught.value.code == "-221"


@pytest.mark.parametrize(
    ("first", "code"),
    [(b'-350,"Queue overflow"\n', "-350"), (b'-410,"Query INTERRUPTED"\n', "-410"), (b'-420,"x"\n', "-420")],
)
def test_a_filled_error_queue_is_emptied_and_the_next_setting_is_taken(first: bytes, code: str) -> None:
    queue = [first, *[b'-222,"Data out of range"\n'] * 19]

    class Filled(Echo):
        def __call__(self, line: str) -> bytes | None:
            if line == "SYST:ERR?" and self.kept.get("FREQ") == "21" and queue:
                return queue.pop(0)
            return super().__call__(line)

    with ScriptedInstrument(Filled({})) as instrument:
        driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=instrument.resource, timeout_s=0.4))
        driver.open()
        driver.arm_sine(20.0, 1.0, 0.0, triggered=False)
        with pytest.raises(InstrumentRefused, match=f"frequency = 21 Hz: {code} ") as caught:
            driver.set_frequency(21.0)
        assert (caught.value.code, queue) == (code, [])
        driver.set_frequency(22.0)
        assert instrument.lines[-3:] == ["FREQ 22", "FREQ?", "SYST:ERR?"]
        driver.close()


def test_a_late_answer_is_not_taken_for_the_next() -> None:
    late = [b""]

    class Late(Echo):
        def __call__(self, line: str) -> bytes | None:
            if line == "*OPC?" and late:
                return late.pop()
            if line == "OUTP OFF":  # the late answer comes just before that to the next question
                return b"1\n" + (super().__call__(line) or b"")
            return super().__call__(line)

    with ScriptedInstrument(Late({})) as instrument:
        driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=instrument.resource, timeout_s=0.4))
        driver.open()
        with pytest.raises(InstrumentSilent, match="OPC"):
            driver.arm_sine(20.0, 1.0, 0.0, triggered=False)
        driver.off()
        driver.close()


def test_no_late_answer_passes_for_an_output_that_is_off() -> None:
    """It comes with the answer to whatever is asked next, long after the question that it is one to."""
    late = [b"0\n", b""]

    class Stuck(Echo):
        def __call__(self, line: str) -> bytes | None:
            if line == "OUTP?" and "FREQ" in self.kept:
                return b"".join(late) + b"1\n"
            if line == "SYST:ERR?" and self.kept.get("FREQ") == "21":
                return late.pop()
            if line == "*IDN?" and "FREQ" in self.kept:
                return late.pop() + (super().__call__(line) or b"")
            return super().__call__(line)

    with ScriptedInstrument(Stuck({})) as instrument:
        driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=instrument.resource, timeout_s=0.4))
        driver.open()
        driver.arm_sine(20.0, 1.0, 0.0, triggered=False)
        with pytest.raises(InstrumentSilent, match="SYST:ERR"):
            driver.set_frequency(21.0)
        with pytest.raises(InstrumentRefused, match="the output does not go off, it answers '1'"):
            driver.off()
        assert "OUTP OFF" in instrument.lines[-4:]
        driver.close()


def test_two_silences_leave_no_answer_too_many() -> None:
    """What was asked for twice comes twice, all of it at once."""
    asleep = list[str]()

    class Asleep(Echo):
        def __call__(self, line: str) -> bytes | None:
            if line in ("A?", "*IDN?") and self.kept.get("SLEEP") == "1" and len(asleep) < 2:
                asleep.append(line)
                return b""
            answers = b"".join(
                b"a\n" if each == "A?" else super(Asleep, self).__call__(each) or b"" for each in asleep
            )
            asleep.clear()
            self.kept.pop("SLEEP", None)
            return answers + (b"b\n" if line == "B?" else super().__call__(line) or b"")

    with ScriptedInstrument(Asleep({})) as instrument:
        link = ScpiLink("generator", instrument.resource, timeout_s=0.3)
        link.open()
        link.identity = link.query("*IDN?")
        link.write("SLEEP 1")
        for question in ("A?", "B?"):
            with pytest.raises(InstrumentSilent):
                link.query(question)
        assert link.query("B?") == "b"
        assert link.query("B?") == "b"
        link.close()


def test_a_late_answer_is_not_taken_for_the_next_whoever_asks_between() -> None:
    """Sequence and guard share a link: what one found says nothing of the other's question."""
    answers = {"A?": b"a\n", "B?": b"", "X": b"late\n", "C?": b"c\n"}

    with ScriptedInstrument(lambda line: answers.get(line, b"")) as instrument:
        link = ScpiLink("generator", instrument.resource, timeout_s=0.2)
        link.open()

        class Turn:
            """As soon as the first has let go, the guard has its turn."""

            lock, asked = link._turn, False

            def acquire(self, timeout: float) -> bool:
                return self.lock.acquire(timeout=timeout)

            def release(self) -> None:
                self.lock.release()
                if not self.asked:
                    self.asked = True
                    with pytest.raises(InstrumentSilent, match=r"B\?"):
                        link.query("B?")

        link._turn = Turn()  # type: ignore[assignment]
        try:
            assert link.query("A?") == "a"
            link.write("X")
            assert link.query("C?") == "c"
        finally:
            link.close()


@pytest.mark.parametrize("say", [ScpiLink.write_at_once, ScpiLink.query])
def test_an_exchange_that_hangs_keeps_nobody_for_ever(
    monkeypatch: pytest.MonkeyPatch, say: Callable[[ScpiLink, str], object]
) -> None:
    """As where a library never returns: whoever is to switch off goes on to the next that may."""
    monkeypatch.setattr("drivers.scpi.link.DRAIN_S", 0.1)
    heard = list[str]()

    def instrument_says(line: str) -> bytes:
        heard.append(line)
        return b""

    with ScriptedInstrument(instrument_says) as instrument:
        link = ScpiLink("generator", instrument.resource, timeout_s=0.1)
        link.open()
        held, over = threading.Event(), threading.Event()

        def hang() -> None:
            with link._turn:
                held.set()
                over.wait(30.0)

        thread = threading.Thread(target=hang)
        thread.start()
        assert held.wait(5.0)
        try:
            with pytest.raises(InstrumentSilent, match="not sent: another exchange with it hangs"):
                say(link, "OUTP OFF")
            if say is ScpiLink.write_at_once:  # past it all the same
                await_true("it is heard", lambda: "OUTP OFF" in heard)
        finally:
            over.set()
            thread.join()
            link.close()


@pytest.mark.parametrize("error", [rpc.RPCUnpackError("no reply but 7"), EOFError("no reply but 7")])
def test_a_reply_over_vxi_11_that_is_none_is_a_lost_device(error: Exception) -> None:
    def garbled(*_: object) -> None:
        raise error

    visa: Any = SimpleNamespace(visalib=None, session=0, write=garbled, close=garbled)
    link = ScpiLink("generator", "TCPIP::192.168.0.5::INSTR")
    link._visa = visa
    with pytest.raises(DeviceLost, match=r"the connection is lost \(no reply but 7\)"):
        link.write("OUTP OFF")
    link.close()


def test_an_output_that_does_not_keep_off_is_told() -> None:
    class Stuck(Echo):
        def __call__(self, line: str) -> bytes | None:
            return super().__call__("OUTP ON" if line == "OUTP OFF" else line)

    with pytest.raises(InstrumentRefused, match="output = OFF reads back '1'"):
        arm(Stuck({}))


IN_USE = r"its output is on already .* nothing was changed. Check who drives with it.*by hand"


@pytest.mark.parametrize("since", ["before", "meanwhile"])
def test_one_that_somebody_drives_with_is_refused_and_left_alone(since: str) -> None:
    echo = Echo({})
    with ScriptedInstrument(echo) as instrument:
        driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=instrument.resource, timeout_s=0.4))
        try:
            if since == "before":
                echo.kept["OUTP"] = "ON"
                with pytest.raises(InstrumentRefused, match=IN_USE):
                    driver.open()
            else:
                driver.open()
                instrument.lines.clear()
                echo.kept["OUTP"] = "ON"
                with pytest.raises(InstrumentRefused, match=IN_USE):
                    driver.arm_sine(20.0, 1.0, 0.0, triggered=False)
            driver.off()  # as on every way out of a run
        finally:
            driver.close()
    assert {*instrument.lines} <= {"", "*IDN?", "OUTP?"}
    assert "OUTP?" in instrument.lines
