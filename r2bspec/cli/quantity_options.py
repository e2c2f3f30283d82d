"""Options whose values are quantities of the language, such as ``20 s`` or ``5 %``."""

from __future__ import annotations

import click

from r2bspec.language.quantities import Duration, Quantity, QuantityError, Share


class QuantityType(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A quantity with its unit, within limits; the error for a bare number proposes the unit."""

    def __init__(self, kind: type[Quantity], lowest: str, highest: str) -> None:
        self.name = kind.kind
        self._kind = kind
        self._lowest, self._highest = kind.parse(lowest), kind.parse(highest)

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> Quantity:
        """The quantity of a text; a quantity stays as it is."""
        if isinstance(value, Quantity):
            return value
        try:
            found = self._kind.parse(str(value))
        except QuantityError as error:
            proposal = f"; for example '{error.suggestion}'" if error.suggestion else ""
            self.fail(f"{error}{proposal}", param, ctx)
        if found < self._lowest or found > self._highest:
            self.fail(f"{found} is not between {self._lowest} and {self._highest}", param, ctx)
        return found

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """What the help shows in place of the value."""
        del param, ctx
        return self.name.upper()


def duration(lowest: str, highest: str) -> QuantityType:
    """The type of an option that takes a duration."""
    return QuantityType(Duration, lowest, highest)


def share(lowest: str, highest: str) -> QuantityType:
    """The type of an option that takes a share."""
    return QuantityType(Share, lowest, highest)
