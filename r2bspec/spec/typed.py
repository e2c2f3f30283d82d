"""The last step: from a document that obeys the schema to a `Spec`."""

from __future__ import annotations

from typing import Any

import msgspec

from r2bspec.spec.codec import decode
from r2bspec.spec.model import Spec


def to_spec(plain: dict[str, Any]) -> Spec:
    """Convert a document that the strict schema accepts.

    The shorthands are written out first: a bag as one string, and one condition instead of a
    list of them.

    Raises:
        msgspec.ValidationError: the schema accepted what the types do not; a bug here.
    """
    document = dict(plain)
    loader = document["data_loader"]
    if isinstance(loader["bag"], str):
        document["data_loader"] = {**loader, "bag": bag_source(loader["bag"])}
    benchmark = document.get("benchmark", {})
    search = benchmark.get("search", {})
    if isinstance(search.get("holds"), str):
        search = {**search, "holds": [search["holds"]]}
        document["benchmark"] = {**benchmark, "search": search}
    return msgspec.convert(document, Spec, dec_hook=decode)


def bag_source(text: str) -> dict[str, str]:
    """What a bag written as one string means: a path if it looks like one, else a dataset."""
    return {"path" if "/" in text or text.startswith(".") else "dataset": text}
