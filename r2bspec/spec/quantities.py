"""Quantities of the language: strings with units, parsed to exact numbers.

Grammar, for every kind::

    quantity = number [ws] unit
    number   = digits ["." digits] [("e" | "E") ["+" | "-"] digits]

A duration is kept in whole nanoseconds, a rate in hertz, a size in bytes and a share as a
fraction of one. A bare number has no unit and is refused: its meaning would be a guess.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from typing import ClassVar

_NUMBER = r"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(rf"(?P<number>{_NUMBER})\s*(?P<unit>[A-Za-zµμ%/]+)")


class QuantityError(ValueError):
    """A string that is not a quantity of the kind asked for.

    Attributes:
        suggestion: a text that would have been accepted, or empty.
    """

    def __init__(self, message: str, suggestion: str = "") -> None:
        super().__init__(message)
        self.suggestion = suggestion


@dataclass(frozen=True, slots=True, order=True)
class Quantity:
    """A number with the dimension that its class names; `text` is what the user wrote."""

    units: ClassVar[dict[str, Decimal]] = {}
    kind: ClassVar[str] = "quantity"
    example: ClassVar[str] = ""

    @classmethod
    def _scaled(cls, text: str) -> Decimal:
        match = _QUANTITY.fullmatch(text.strip())
        known = ", ".join(cls.units)
        if match is None:
            bare = re.fullmatch(_NUMBER, text.strip())
            if bare is not None:
                default = next(iter(cls.units))
                raise QuantityError(
                    f"{text!r} has no unit; a {cls.kind} needs one of {known}",
                    suggestion=f"{text.strip()} {default}",
                )
            raise QuantityError(
                f"{text!r} is not a {cls.kind}; write a number and one of {known}",
                suggestion=cls.example,
            )
        unit = match["unit"].replace("μ", "µ")
        if unit not in cls.units:
            raise QuantityError(
                f"{match['unit']!r} is not a unit of {cls.kind}; known are {known}",
                suggestion=cls.example,
            )
        number = Decimal(match["number"])
        # 10^100 s would overflow every clock; the limit is generous and keeps integers small.
        if number.adjusted() > 15:
            raise QuantityError(f"{text!r} is too large for a {cls.kind}")
        return number * cls.units[unit]


@dataclass(frozen=True, slots=True, order=True)
class Duration(Quantity):
    """A length of time in whole nanoseconds."""

    ns: int
    kind: ClassVar[str] = "duration"
    example: ClassVar[str] = "10 s"
    units: ClassVar[dict[str, Decimal]] = {
        "s": Decimal(10**9),
        "ms": Decimal(10**6),
        "us": Decimal(1000),
        "µs": Decimal(1000),
        "ns": Decimal(1),
        "min": Decimal(60 * 10**9),
        "h": Decimal(3600 * 10**9),
    }

    @classmethod
    def parse(cls, text: str) -> Duration:
        """Parse a duration such as ``10 s`` or ``150ms``.

        Raises:
            QuantityError: the text is no duration.
        """
        return cls(int(cls._scaled(text).to_integral_value()))

    @property
    def seconds(self) -> float:
        """The duration in seconds."""
        return self.ns / 1e9

    def __str__(self) -> str:
        for unit in ("s", "ms", "us"):
            scale = int(self.units[unit])
            if self.ns >= scale:
                return f"{_plain(Decimal(self.ns) / scale)} {unit}"
        return f"{self.ns} ns" if self.ns else "0 s"


@dataclass(frozen=True, slots=True, order=True)
class Rate(Quantity):
    """A frequency in hertz."""

    hz: float
    kind: ClassVar[str] = "rate"
    example: ClassVar[str] = "30 Hz"
    units: ClassVar[dict[str, Decimal]] = {
        "Hz": Decimal(1),
        "kHz": Decimal(1000),
        "fps": Decimal(1),
        "mHz": Decimal("0.001"),
    }

    @classmethod
    def parse(cls, text: str) -> Rate:
        """Parse a rate such as ``30 Hz``.

        Raises:
            QuantityError: the text is no rate.
        """
        return cls(float(cls._scaled(text)))

    def __str__(self) -> str:
        return f"{_plain(Decimal(repr(self.hz)))} Hz"


@dataclass(frozen=True, slots=True, order=True)
class Size(Quantity):
    """An amount of memory or data in bytes."""

    bytes: int
    kind: ClassVar[str] = "size"
    example: ClassVar[str] = "64 MiB"
    units: ClassVar[dict[str, Decimal]] = {
        "MiB": Decimal(2**20),
        "KiB": Decimal(2**10),
        "GiB": Decimal(2**30),
        "B": Decimal(1),
        "kB": Decimal(10**3),
        "MB": Decimal(10**6),
        "GB": Decimal(10**9),
    }

    @classmethod
    def parse(cls, text: str) -> Size:
        """Parse a size such as ``64 MiB``.

        Raises:
            QuantityError: the text is no size.
        """
        return cls(int(cls._scaled(text).to_integral_value()))

    def __str__(self) -> str:
        for unit in ("GiB", "MiB", "KiB"):
            scale = int(self.units[unit])
            if self.bytes >= scale and self.bytes * 10 % scale == 0:
                return f"{_plain(Decimal(self.bytes) / scale)} {unit}"
        return f"{self.bytes} B"


@dataclass(frozen=True, slots=True, order=True)
class Share(Quantity):
    """A fraction; ``2 %`` is kept as 0.02."""

    fraction: float
    kind: ClassVar[str] = "share"
    example: ClassVar[str] = "2 %"
    units: ClassVar[dict[str, Decimal]] = {"%": Decimal("0.01")}

    @classmethod
    def parse(cls, text: str) -> Share:
        """Parse a share such as ``0.5 %``.

        Raises:
            QuantityError: the text is no share.
        """
        return cls(float(cls._scaled(text)))

    def __str__(self) -> str:
        return f"{_plain(Decimal(repr(self.fraction)) * 100)} %"


def _plain(number: Decimal) -> str:
    """Write a decimal without exponent and without trailing zeros."""
    text = format(number.normalize(), "f")
    return text.rstrip("0").rstrip(".") if "." in text else text
