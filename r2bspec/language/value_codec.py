"""Reading and writing the values that are strings in a document: quantities, requirements."""

from __future__ import annotations

from typing import Any

from r2bspec.language.quantities import Quantity
from r2bspec.language.requirement_grammar import Requirement


def encode(value: object) -> str:
    """The `enc_hook` of msgspec: a quantity or a requirement as text."""
    if isinstance(value, Quantity):
        return str(value)
    if isinstance(value, Requirement):
        return value.text
    raise NotImplementedError(f"cannot write {type(value).__name__}")


def decode(kind: type, value: object) -> Any:
    """The `dec_hook` of msgspec: the inverse of `encode`.

    Raises:
        QuantityError: the text is not a quantity of that kind.
        RequirementError: the text is not a requirement.
    """
    if isinstance(value, kind):
        return value
    if isinstance(value, str) and issubclass(kind, Quantity | Requirement):
        return kind.parse(value)
    raise NotImplementedError(f"cannot read a {kind.__name__} from {type(value).__name__}")
