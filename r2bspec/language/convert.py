"""The last step: from a document that obeys the schema to a `Spec`."""

from __future__ import annotations

from typing import Any

import msgspec

from r2bspec.language.shorthand import expand_shorthands
from r2bspec.language.spec import Spec
from r2bspec.language.value_codec import decode


def to_spec(plain: dict[str, Any]) -> Spec:
    """Convert a document that the strict schema accepts; its shorthands are written out first.

    Raises:
        msgspec.ValidationError: the schema accepted what the types do not; a bug here.
    """
    return msgspec.convert(expand_shorthands(plain), Spec, dec_hook=decode)
