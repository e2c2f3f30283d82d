"""Quantities of the language: strings with a unit, parsed to exact numbers.

Grammar, for every kind::

    quantity = number [ws] unit
    number   = digits ["." digits] [("e" | "E") ["+" | "-"] digits]

A duration is stored in whole nanoseconds, a rate in hertz, a size in bytes and a share as a
fraction of one. A number without a unit is refused: its meaning would be a guess.
"""

from __future__ import annotations

import re
from decimal import Decimal
from functools import lru_cache, total_ordering
from typing import ClassVar, Final, Literal, Self

from r2bspec.diagnostics.quote import quote
from r2bspec.safe_io.limits import MAX_QUANTITY_CHARACTERS

_NUMBER = r"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(rf"(?P<number>{_NUMBER})\s*(?P<unit>[A-Za-zµμ%/]+)", re.ASCII)
_UNITLESS = re.compile(_NUMBER, re.ASCII)
_UNIT_ALIASES = {
    "sec": "s",
    "secs": "s",
    "second": "s",
    "seconds": "s",
    "msec": "ms",
    "millisecond": "ms",
    "milliseconds": "ms",
    "usec": "us",
    "microseconds": "us",
    "nsec": "ns",
    "nanoseconds": "ns",
    "minute": "min",
    "minutes": "min",
    "hour": "h",
    "hours": "h",
    "hertz": "Hz",
    "percent": "%",
    "bytes": "B",
}
"""Other names of units, and the unit that each means."""


class QuantityError(ValueError):
    """A string that is not a quantity of the required kind.

    Attributes:
        suggestion: a valid text, or empty.
        is_equivalent: whether the suggestion means the same as the text, and is not an example.
    """

    def __init__(self, message: str, suggestion: str = "", *, is_equivalent: bool = False) -> None:
        super().__init__(message)
        self.suggestion = suggestion
        self.is_equivalent = is_equivalent


@total_ordering
class Quantity:
    """A number with the dimension that its class names: immutable, ordered, hashable.

    Not a dataclass: msgspec would read it from a JSON object, but a quantity is a string in every
    document (see `r2bspec.language.declaration`).
    """

    __slots__ = ("_value",)
    units: ClassVar[dict[str, Decimal]] = {}
    kind: ClassVar[str] = "quantity"
    dimension: ClassVar[Literal["time", "rate", "size", "share", "power", "energy"]]
    example: ClassVar[str] = ""
    whole: ClassVar[bool] = False

    def __init__(self, value: float) -> None:
        self._value = value

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and other._value == self._value

    def __lt__(self, other: Quantity) -> bool:
        if type(other) is not type(self):
            raise TypeError(f"a {self.kind} cannot be compared with {type(other).__name__}")
        return self._value < other._value

    def __hash__(self) -> int:
        return hash((self.kind, self._value))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._value!r})"

    @property
    def is_positive(self) -> bool:
        """Whether it is more than zero."""
        return self._value > 0

    @property
    def si(self) -> float:
        """The value in its SI unit; a share as a fraction."""
        return float(self._value)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a text such as `example`.

        Raises:
            QuantityError: the text is not a quantity of this kind.
        """
        number = cls._scaled(text)
        return cls(int(number.to_integral_value()) if cls.whole else float(number))

    @classmethod
    def units_text(cls) -> str:
        """Return a clause on the units: ``the unit of a share is %``."""
        if len(cls.units) == 1:
            return f"the unit of a {cls.kind} is {next(iter(cls.units))}"
        return f"the units of a {cls.kind} are {', '.join(cls.units)}"

    @classmethod
    @lru_cache(maxsize=4096)
    def _scaled(cls, text: str) -> Decimal:
        if len(text) > MAX_QUANTITY_CHARACTERS:
            raise QuantityError(f"the text is too long for a {cls.kind}", suggestion=cls.example)
        match = _QUANTITY.fullmatch(text.strip())
        if match is None:
            if _UNITLESS.fullmatch(text.strip()):
                default = next(iter(cls.units))
                raise QuantityError(
                    f"{quote(text)} has no unit; {cls.units_text()}",
                    suggestion=f"{text.strip()} {default}",
                )
            if text.lstrip().startswith("-"):
                raise QuantityError(f"a {cls.kind} cannot be negative", suggestion=cls.example)
            raise QuantityError(
                f"{quote(text)} is not a {cls.kind}: expected a number with a unit, such as "
                f"{cls.example}; {cls.units_text()}",
                suggestion=cls.example,
            )
        unit = match["unit"].replace("μ", "µ")
        if unit not in cls.units:
            meant = cls._known_unit(unit)
            raise QuantityError(
                f"unknown unit {quote(match['unit'])}; {cls.units_text()}",
                suggestion=f"{match['number']} {meant}" if meant else cls.example,
                is_equivalent=bool(meant),
            )
        # Decimal does not support larger exponents.
        if re.search(r"[eE][+-]?\d{4}", match["number"]):
            raise QuantityError(f"{quote(text)} is out of range for a {cls.kind}")
        number = Decimal(match["number"])
        # 10^100 s would overflow every clock; the limit keeps integers small.
        if number.adjusted() > 15:
            raise QuantityError(f"{quote(text)} is too large for a {cls.kind}")
        # Its inverse, such as the period of a rate, would overflow a float.
        if number and number.adjusted() < -30:
            raise QuantityError(f"{quote(text)} is too small for a {cls.kind}")
        return number * cls.units[unit]

    @classmethod
    def _known_unit(cls, unit: str) -> str:
        """Return the unit that a word certainly means, or an empty string."""
        folded = unit.casefold()
        by_fold = {name.casefold(): name for name in reversed(cls.units)}
        meant = by_fold.get(folded) or _UNIT_ALIASES.get(folded, "")
        # MHz is not mHz: where the capital changes the prefix, there is no guess.
        ambiguous = unit.startswith("M") and meant.startswith("m")
        return meant if meant in cls.units and not ambiguous else ""


class Duration(Quantity):
    """A duration in whole nanoseconds."""

    __slots__ = ()
    kind: ClassVar[str] = "duration"
    dimension: ClassVar[Literal["time"]] = "time"
    example: ClassVar[str] = "10 s"
    whole: ClassVar[bool] = True
    units: ClassVar[dict[str, Decimal]] = {
        "s": Decimal(10**9),
        "ms": Decimal(10**6),
        "us": Decimal(1000),
        "µs": Decimal(1000),
        "ns": Decimal(1),
        "min": Decimal(60 * 10**9),
        "h": Decimal(3600 * 10**9),
    }

    @property
    def ns(self) -> int:
        """The value in nanoseconds."""
        return int(self._value)

    @property
    def seconds(self) -> float:
        """The duration in seconds."""
        return self.ns / 1e9

    si = seconds

    def __str__(self) -> str:
        for unit in ("s", "ms", "us"):
            scale = int(self.units[unit])
            if self.ns >= scale:
                return f"{_format_decimal(Decimal(self.ns) / scale)} {unit}"
        return f"{self.ns} ns" if self.ns else "0 s"


class Rate(Quantity):
    """A frequency in hertz."""

    __slots__ = ()
    kind: ClassVar[str] = "rate"
    dimension: ClassVar[Literal["rate"]] = "rate"
    example: ClassVar[str] = "30 Hz"
    units: ClassVar[dict[str, Decimal]] = {
        "Hz": Decimal(1),
        "kHz": Decimal(1000),
        "fps": Decimal(1),
        "mHz": Decimal("0.001"),
    }

    @property
    def hz(self) -> float:
        """The value in hertz."""
        return self._value

    def __str__(self) -> str:
        return f"{_format_decimal(Decimal(repr(self.hz)))} Hz"


class Size(Quantity):
    """An amount of memory or data in bytes."""

    __slots__ = ()
    kind: ClassVar[str] = "size"
    dimension: ClassVar[Literal["size"]] = "size"
    whole: ClassVar[bool] = True
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

    @property
    def bytes(self) -> int:
        """The value in bytes."""
        return int(self._value)

    def __str__(self) -> str:
        for unit in ("GiB", "MiB", "KiB"):
            scale = int(self.units[unit])
            if self.bytes >= scale and self.bytes * 10 % scale == 0:
                return f"{_format_decimal(Decimal(self.bytes) / scale)} {unit}"
        return f"{self.bytes} B"


class Share(Quantity):
    """A fraction; ``2 %`` is stored as 0.02."""

    __slots__ = ()
    kind: ClassVar[str] = "share"
    dimension: ClassVar[Literal["share"]] = "share"
    example: ClassVar[str] = "2 %"
    units: ClassVar[dict[str, Decimal]] = {"%": Decimal("0.01")}

    @property
    def fraction(self) -> float:
        """The value as a fraction of 1."""
        return self._value

    def __str__(self) -> str:
        return f"{_format_decimal(Decimal(repr(self.fraction)) * 100)} %"


class Power(Quantity):
    """A power in watts."""

    __slots__ = ()
    kind: ClassVar[str] = "power"
    dimension: ClassVar[Literal["power"]] = "power"
    example: ClassVar[str] = "15 W"
    units: ClassVar[dict[str, Decimal]] = {
        "W": Decimal(1),
        "mW": Decimal("0.001"),
        "kW": Decimal(1000),
    }


class Energy(Quantity):
    """An energy in joules."""

    __slots__ = ()
    kind: ClassVar[str] = "energy"
    dimension: ClassVar[Literal["energy"]] = "energy"
    example: ClassVar[str] = "500 mJ"
    units: ClassVar[dict[str, Decimal]] = {
        "J": Decimal(1),
        "mJ": Decimal("0.001"),
        "kJ": Decimal(1000),
    }


def _format_decimal(number: Decimal) -> str:
    """Return a decimal number as text, without exponent and trailing zeros."""
    text = format(number.normalize(), "f")
    return text.rstrip("0").rstrip(".") if "." in text else text


QUANTITIES: Final[dict[str, type[Quantity]]] = {
    quantity.kind: quantity for quantity in (Duration, Rate, Size, Share, Power, Energy)
}
"""The kinds of quantity by their names."""
