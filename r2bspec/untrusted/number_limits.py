"""The numbers that stored plans, records and results may hold.

JSON allows numbers of any size. Arithmetic on them ends in an overflow somewhere, far from the file
that is to blame; so they are refused where the file is read.
"""

from __future__ import annotations

from typing import Any, Final

import msgspec

MAX_INTEGER: Final = 2**63 - 1
"""Times are nanoseconds in 64 bits with a sign, in every file and array."""

MAX_NUMBER: Final = 1e30
"""Far beyond every rate, time and size there is, and far from the limits of a float."""


def check_numbers(value: Any, free: frozenset[str] = frozenset()) -> None:
    """See that no number inside a decoded value is out of range.

    Args:
        value: what was decoded.
        free: fields whose numbers are only passed on, such as the parameters of nodes.

    Raises:
        ValueError: one is; the message has the way to it.
    """
    waiting: list[tuple[str, Any]] = [("$", value)]
    while waiting:
        place, each = waiting.pop()
        if isinstance(each, bool | str | bytes) or each is None:
            continue
        if isinstance(each, int | float):
            limit = MAX_INTEGER if isinstance(each, int) else MAX_NUMBER
            if not -limit <= each <= limit and each == each:  # NaN is a number of its own
                raise ValueError(f"a number is out of range at {place}")
        elif isinstance(each, msgspec.Struct):
            waiting += [
                (f"{place}.{name}", getattr(each, name))
                for name in each.__struct_fields__
                if name not in free
            ]
        elif isinstance(each, dict):
            waiting += [(f"{place}[...]", one) for one in each.values()]
        elif isinstance(each, list | tuple):
            waiting += [(f"{place}[{number}]", one) for number, one in enumerate(each)]
