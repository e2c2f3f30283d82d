"""The lists of keys in docs/language.md, made of the rules of the language."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

from r2bspec.language.declaration import ValueRule, language

_TABLE_BLOCK = re.compile(r"<!-- keys of (?P<path>\S+) -->\n.*?<!-- end -->", re.DOTALL)


def with_tables(text: str) -> str:
    """The text with every list replaced by that of the current language.

    A list is between ``<!-- keys of PATH -->`` and ``<!-- end -->``; ``spec`` is the document
    itself, and ``<name>`` in a path is any name given by the user. Keys that a list has in common
    with one before it, such as those of a process, share a line that refers to that list.
    """
    examples = "".join(re.findall(r"^```yaml\n(.*?)^```", text, re.DOTALL | re.MULTILINE))
    shown: dict[str, str] = {}

    def table(found: re.Match[str]) -> str:
        path = found["path"]
        same: dict[str, list[str]] = {}
        lines = []
        for name, row in _rows(path, examples).items():
            if row in shown:
                same.setdefault(shown[row], []).append(f"`{name}`")
            else:
                lines.append(row)
                shown[row] = path
        lines += [f"- {', '.join(keys)}: as in `{first}`" for first, keys in same.items()]
        return "\n".join([f"<!-- keys of {path} -->", *lines, "<!-- end -->"])

    return _TABLE_BLOCK.sub(table, text)


def _rows(path: str, examples: str) -> dict[str, str]:
    """The line of each key of the map at a path; `examples` are those of the page."""
    owner: ValueRule | None = language()
    for part in path.split(".") if path != "spec" else ():
        owner = owner.below(part) if owner is not None else None
    if owner is None or owner.keys is None:
        raise KeyError(f"the language has no map {path}")
    rows = {}
    for name, rule in owner.keys.items():
        value = ", ".join(filter(None, (_kind(rule), _default(rule, name in owner.required))))
        example = "" if re.search(rf"\b{name}: ", examples) else _example(rule)
        rows[name] = f"- `{name}` ({value}): " + " ".join(filter(None, (rule.description, example)))
    return rows


def _kind(rule: ValueRule) -> str:
    words = [f"`{word}`" for word in rule.words]
    if rule.is_parsed and rule.quantity is not None:
        return " or ".join([rule.quantity.kind, *words])
    if rule.is_choice:
        return ", ".join(words)
    if rule.const is not None:
        return f"`{rule.const}`"
    called = {"object": "map", "array": "list"}
    kinds: Sequence[str] = rule.kinds or ("any",)
    shown = [called.get(name, name) for name in kinds if not (words and name == "string")]
    return ", ".join([*words, *shown])


def _default(rule: ValueRule, required: bool) -> str:
    if required:
        return "required"
    default = rule.shown_default
    shown = default not in (None, "", [], {}) or default is False
    return f"default `{_flow(default)}`" if shown else ""


def _example(rule: ValueRule) -> str:
    """Return an example of a list or a map, unless another column or table shows its form."""
    if not rule.about.examples or rule.is_choice or rule.const is not None or rule.keys is not None:
        return ""
    value = rule.about.examples[0]
    shown = _flow(value)
    if not isinstance(value, dict | list) or len(shown) > 60 or value == rule.shown_default:
        return ""
    return f"Example: `{shown}`."


def _flow(value: object) -> str:
    """A value as YAML on one line; strings are unquoted."""
    if isinstance(value, str):
        return value
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return json.dumps(value)
