"""The far end of SCPI: program messages taken apart and matched with a tree of commands.

Syntax after SCPI-1999 volume 1, sections 5 to 7: long and short forms, optional nodes, the optional suffix 1,
compound messages with `;` whose path carries on, common commands with `*`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

TEXTS = {  # SCPI-1999: -1xx command, -2xx execution, -3xx device, -4xx query errors
    0: "No error",
    -101: "Invalid character",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    -121: "Invalid character in number",
    -131: "Invalid suffix",
    -148: "Character data not allowed",
    -211: "Trigger ignored",
    -221: "Settings conflict",
    -222: "Data out of range",
    -224: "Illegal parameter value",
    -241: "Hardware missing",
    -350: "Error queue overflow",
    -363: "Input buffer overrun",
    -410: "Query INTERRUPTED",
    -420: "Query UNTERMINATED",
    -430: "Query DEADLOCKED",
}
_NUMBER = re.compile(r"([+-]?(?:\d{1,99}(?:\.\d{0,99})?|\.\d{1,99})(?:E[+-]?\d{1,5})?)\s{0,9}([A-Z]{0,9})")
_UNITS = re.compile(r"""(?:[^;"']|"[^"]*"|'[^']*'|["'])+""")  # a ; within quotes parts nothing
_PARAMETERS = re.compile(r"""(?:[^,"']|"[^"]*"|'[^']*'|["'])+""")  # nor does a comma


class CommandError(Exception):
    """A command that the instrument will not have: its SCPI code and what it adds to the standard text."""

    def __init__(self, code: int, detail: str = "") -> None:
        self.code, self.detail = code, detail
        super().__init__(f"{TEXTS.get(code, 'Device-specific error')}{'; ' if detail else ''}{detail}")


@dataclass(frozen=True, slots=True)
class Command:
    """One header, e.g. `[SOURce:]FREQuency`, and what to do with its command and its query form."""

    header: str
    apply: Callable[[Sequence[str]], None] | None = None
    answer: Callable[[Sequence[str]], str] | None = None


class CommandTree:
    """Finds and runs the commands of a program message."""

    def __init__(self, commands: Iterable[Command]) -> None:
        self._commands = [(_pattern(command.header), command) for command in commands]

    def run(self, message: str, report: Callable[[CommandError], None]) -> str | None:
        """Run a message; return its answers joined by `;`, None where it asked nothing.

        What goes wrong is given to `report`. A command error (-1xx) ends the message, an execution error does
        not.
        """
        answers: list[str] = []
        path = ""
        for unit in _UNITS.findall(message):
            text = unit.strip()
            try:
                if text:
                    path = self._run_unit(text, path, answers)
            except CommandError as error:
                report(error)
                if error.code > -200:  # what follows a header that is not known would go to the wrong node
                    break
        return ";".join(answers) if answers else None

    def _run_unit(self, text: str, path: str, answers: list[str]) -> str:
        if not text.isascii() or (not text.isprintable() and "\t" not in text):
            raise CommandError(-101)
        header, *rest = text.split(maxsplit=1)
        parameters = [part.strip() for part in _PARAMETERS.findall(rest[0])] if rest else []
        # A leading : is the root of the tree; without it a header goes on from the path of the one before.
        full = header[1:] if header.startswith(":") else header if header.startswith("*") else path + header
        plain = full.removesuffix("?").upper()
        command = next((each for pattern, each in self._commands if pattern.fullmatch(plain)), None)
        if command is None:
            raise CommandError(-113)
        if full.endswith("?"):
            if command.answer is None:
                raise CommandError(-113)
            answers.append(command.answer(parameters))
        else:
            if command.apply is None:
                raise CommandError(-113)
            command.apply(parameters)
        # a common command leaves the path of the message as it is
        return path if header.startswith("*") else full[: full.rfind(":") + 1]


def single(parameters: Sequence[str]) -> str:
    """Return the one parameter of a command, in capitals."""
    if not parameters:
        raise CommandError(-109)
    if len(parameters) > 1:
        raise CommandError(-108)
    return parameters[0].upper()


def none(parameters: Sequence[str]) -> None:
    """Insist on no parameter."""
    if parameters:
        raise CommandError(-108)


def asked(answer: Callable[[], str]) -> Callable[[Sequence[str]], str]:
    """Return the handler of a query that takes no parameter."""

    def handler(parameters: Sequence[str]) -> str:
        none(parameters)
        return answer()

    return handler


def told(action: Callable[[], None]) -> Callable[[Sequence[str]], None]:
    """Return the handler of a command that takes no parameter."""

    def handler(parameters: Sequence[str]) -> None:
        none(parameters)
        action()

    return handler


def number(text: str, suffixes: dict[str, float]) -> float:
    """Return the number in `text`, times the factor of its suffix."""
    match = _NUMBER.fullmatch(text.upper())
    if match is None:
        raise CommandError(-148 if text[:1].isalpha() else -121)
    if match[2] and match[2] not in suffixes:
        raise CommandError(-131)
    return float(match[1]) * suffixes.get(match[2], 1.0)


def boolean(text: str) -> bool:
    """Return whether `text` says on: ON, OFF, or a number that is not zero."""
    if text in ("ON", "OFF"):
        return text == "ON"
    return round(min(abs(number(text, {})), 1.0)) != 0  # rounded first: 0.4 is off


def word(text: str, *choices: str) -> str:
    """Return the short form of the one of `choices` (written like `IMMediate`) that `text` is."""
    for choice in choices:
        if _pattern(choice).fullmatch(text):
            return "".join(letter for letter in choice if not letter.islower())
    raise CommandError(-224)


def _pattern(header: str) -> re.Pattern[str]:
    parts = {"[": "(?:", "]": ")?", ":": ":", "*": r"\*"}
    tokens = re.findall(r"[A-Z]+[a-z]*|[\[\]:*]", header)
    found = []
    for token in tokens:
        short = "".join(letter for letter in token if letter.isupper())
        found.append(parts.get(token) or f"(?:{token.upper()}|{short})1?")
    return re.compile("".join(found))
