"""Texts for values, types and lists of words in messages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from r2bspec.diagnostics.quote import clip, quote
from r2bspec.language.schema.schema_builder import KIND

_TYPES = {
    "string": "a string",
    "integer": "an integer",
    "number": "a number",
    "boolean": "a boolean",
    "array": "a list",
    "object": "a map",
}


def describe_value(value: object) -> str:
    """A plain value in a message: ``the number 720``, ``a list``."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"the number {value}"
    if isinstance(value, str):
        return f"the string {quote(value)}"
    if isinstance(value, dict):
        return "a map"
    return "a list" if isinstance(value, list) else "null"


def describe_type(schema: dict[str, Any]) -> str:
    """The type that a schema requires: ``a string``, ``a list``, ``a duration``."""
    kind = schema.get(KIND)
    if kind is not None:
        return f"a {kind}"
    types = schema.get("type", "object")
    names = [types] if isinstance(types, str) else types
    return join_words([_TYPES[name] for name in names])


def join_words(words: Sequence[str], joint: str = "or") -> str:
    """``a``, ``a or b``, ``a, b or c``."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {joint} {words[-1]}"


def comma_separated(words: Iterable[str], max_shown: int = 16) -> str:
    """The words, the first `max_shown` of them, separated by commas."""
    all_words = [clip(word) for word in words]
    more = len(all_words) - max_shown
    return ", ".join(all_words[:max_shown]) + (f" and {more} more" if more > 0 else "")


def example(schema: dict[str, Any]) -> str:
    """The first example of a schema as YAML on one line, or an empty string."""
    examples = schema.get("examples")
    return to_flow_yaml(examples[0]) if examples else ""


def to_flow_yaml(value: object) -> str:
    """A plain value as YAML on one line."""
    import yaml

    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)
    return text.removesuffix("...\n").strip()


def example_line(key: str, schema: dict[str, Any]) -> str:
    """A line to add for a missing key, with an example value if it is short enough."""
    text = example(schema)
    return f"'{key}: {text}'" if text and len(text) <= 60 else f"'{key}'"
