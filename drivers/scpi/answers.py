"""What a SCPI instrument answers, taken apart (IEEE 488.2-1992 section 8, SCPI-1999 volume 1 section 7)."""

from __future__ import annotations

import math
import re

INFINITY = 9.9e37  # SCPI-1999 volume 1, 7.2.1.4: how infinity is written
_NUMBER = re.compile(r"[+-]?(\d{1,40}(\.\d{0,40})?|\.\d{1,40})([eE][+-]?\d{1,3})?")
_ERROR = re.compile(r'([+-]?\d{1,6})\s*(?:,\s*"?([^"]{0,300}).*)?', re.DOTALL)


def number(answer: str) -> float:
    """Return the number in an answer, 9.9E37 as infinity; ValueError for anything else, NaN included."""
    text = answer.strip()
    if not _NUMBER.fullmatch(text):
        raise ValueError(f"not a number: {text[:60]!r}")
    value = float(text)
    return math.copysign(math.inf, value) if abs(value) >= INFINITY else value


def error(answer: str) -> tuple[int, str]:
    """Return code and text of an answer to SYST:ERR?; ValueError where it is none."""
    match = _ERROR.fullmatch(answer.strip())
    if match is None:
        raise ValueError(f"not an entry of an error queue: {answer.strip()[:60]!r}")
    return int(match[1]), (match[2] or "").strip()


def model(answer: str) -> str:
    """Return the model in an answer to *IDN? (maker, model, serial, firmware); empty where there is none."""
    fields = answer.split(",")
    return fields[1].strip() if len(fields) >= 2 else ""
