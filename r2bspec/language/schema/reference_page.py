"""The keys of the language as Markdown tables, for docs/language.md."""

from __future__ import annotations

import json
import re
from typing import Any

from r2bspec.language.schema.document_root import DOCUMENT
from r2bspec.language.schema.schema_builder import ALLOWED_WORDS, KIND, UNLESS_LIVE, Schema

_TABLE_BLOCK = re.compile(r"<!-- keys of (?P<path>\S+) -->\n.*?<!-- end -->", re.DOTALL)


def with_tables(text: str) -> str:
    """The text with every table replaced by that of the current schema.

    A table is between ``<!-- keys of PATH -->`` and ``<!-- end -->``; ``spec`` is the document
    itself, and ``<name>`` in a path is any name given by the user.
    """

    def table(found: re.Match[str]) -> str:
        return f"<!-- keys of {found['path']} -->\n{key_table(found['path'])}<!-- end -->"

    return _TABLE_BLOCK.sub(table, text)


def key_table(path: str) -> str:
    """The table of the keys of the map at a path."""
    schema = _schema_at(path)
    required = {*schema.get("required", ()), *schema.get(UNLESS_LIVE, ())}
    lines = ["| key | value | default | meaning | example |", "| --- | --- | --- | --- | --- |"]
    for key, below in schema["properties"].items():
        default = "required" if key in required else _default(below)
        cells = (f"`{key}`", _kind(below), default, _cell(below["description"]), _example(below))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _schema_at(path: str) -> Schema:
    schema = DOCUMENT
    for part in path.split(".") if path != "spec" else ():
        below: Any = schema["properties"][part] if part != "<name>" else None
        schema = below if below is not None else schema["additionalProperties"]
    return schema


def _kind(schema: Schema) -> str:
    if KIND in schema:
        return _cell(
            " or ".join([schema[KIND], *(f"`{word}`" for word in schema.get(ALLOWED_WORDS, ()))])
        )
    if "enum" in schema:
        return ", ".join(f"`{word}`" for word in schema["enum"])
    if "const" in schema:
        return f"`{schema['const']}`"
    types = schema.get("type", "any")
    names = [types] if isinstance(types, str) else types
    called = {"object": "map", "array": "list"}
    words = [f"`{word}`" for word in schema.get(ALLOWED_WORDS, ())]
    kinds = [called.get(name, name) for name in names if not (words and name == "string")]
    return ", ".join([*words, *kinds])


def _default(schema: Schema) -> str:
    default = schema.get("default")
    return "" if default in (None, "", [], {}) and default is not False else f"`{_flow(default)}`"


def _example(schema: Schema) -> str:
    examples = schema.get("examples")
    shown = _flow(examples[0]) if examples else ""
    return f"`{_cell(shown)}`" if shown and len(shown) <= 60 else ""


def _flow(value: object) -> str:
    """A value as YAML on one line; strings are unquoted."""
    if isinstance(value, str):
        return value
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return json.dumps(value)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
