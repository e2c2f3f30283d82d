"""The JSON Schema of the language, generated from its declaration.

It has two forms. The published form is for text, in editors and other tools: it is plain draft-07,
accepts ``$(var x)`` and ``$(env X)`` for every scalar, ignores ``x-`` keys, accepts null in maps
with 'extends', and describes everything. The other form is for a resolved document, which has no
references and no keys to remove: `r2bspec.language.structure` validates specs with it.
"""

from __future__ import annotations

import json
from typing import Any

import msgspec

from r2bspec.language.declaration import NamePattern, ValueRule, language
from r2bspec.language.quantities import Quantity

Schema = dict[str, Any]

TITLE = "r2bspec, version 1"
FILE_NAME = "r2bspec-v1.schema.json"

_NULL_RULE = "nothing_is_removed"
_ANYTHING = "anything"
_REFERENCE = r"\$\((?:var|env) +[A-Za-z_][A-Za-z0-9_]* *\)"
_WHOLE_REFERENCE = f"^{_REFERENCE}$"
_NUMBER = r"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_SCALAR_NAMES = {"integer": "an integer", "boolean": "true or false"}
_WORD = "[A-Za-z][A-Za-z0-9_]*"
_METRIC = rf"{_WORD}(?:/{_WORD})*(?:\.{_WORD})*"
_REQUIREMENT = rf"^\s*(?:sustained|{_METRIC}\s*(?:[<>]=?|[=!]=)\s*\d.*?)\s*$"
_NULL_MESSAGE = "missing value; null removes a key of an extended map"


def published_schema() -> Schema:
    """Return the schema for editors, as `r2bspec docs --schema spec` prints it.

    Null is allowed for every key, because it removes a key that `extends` brings, and refused
    outside of maps with `extends` by a small schema of its own.
    """
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "$id": FILE_NAME,
        "title": TITLE,
        **_SchemaWriter(for_text=True).schema(language()),
        "definitions": {_NULL_RULE: _null_rule()},
        "allOf": [{"$ref": f"#/definitions/{_NULL_RULE}"}],
    }


def published_schema_text() -> str:
    """Return the published schema as a file, with a newline at its end."""
    return json.dumps(published_schema(), indent=2, ensure_ascii=False) + "\n"


def resolved_schema(rule: ValueRule, *, live: bool, calls: bool) -> Schema:
    """Return the schema of a value in a resolved document.

    Args:
        rule: the rule of the value.
        live: whether the document plays nothing, so that less is required.
        calls: whether it calls services, likewise.
    """
    itself = {"$ref": f"#/definitions/{_ANYTHING}"}
    anything = {
        "type": ["string", "number", "boolean", "array", "object"],
        "items": itself,
        "additionalProperties": itself,
    }
    return {
        **_SchemaWriter(for_text=False, live=live, calls=calls).schema(rule),
        "definitions": {_ANYTHING: anything},
    }


def _null_rule() -> Schema:
    """No value is null, except below a map that extends another.

    Written with 'not' instead of 'type', so that editors do not propose values because of it.
    """
    itself = {"$ref": f"#/definitions/{_NULL_RULE}"}
    return {
        "if": {"type": "object", "required": ["extends"]},
        "else": {
            "not": {"type": "null"},
            "errorMessage": _NULL_MESSAGE,
            "additionalProperties": itself,
            "items": itself,
        },
    }


class _SchemaWriter(msgspec.Struct, frozen=True):
    """Writes the schemas of rules.

    Attributes:
        for_text: whether the schema is the published one.
        live: whether the document plays nothing.
        calls: whether it calls services.
    """

    for_text: bool
    live: bool = True
    calls: bool = True

    def schema(self, rule: ValueRule, *, removable: bool = False) -> Schema:
        """Return the schema of a rule; in text, a removable value may be null."""
        if not rule.kinds and not self.for_text:
            return {"$ref": f"#/definitions/{_ANYTHING}"}
        about = rule.about
        schema: Schema = {"description": rule.description} if self.for_text else {}
        kinds = self._types(rule)
        if kinds:
            # Null comes last: editors insert a value of the first type.
            kinds = (*kinds, "null") if removable and self.for_text else kinds
            schema["type"] = list(kinds) if len(kinds) > 1 else kinds[0]
        schema |= self._text(rule)
        limits = {
            "minimum": about.minimum,
            "maximum": about.maximum,
            "const": rule.const,
            "minLength": 1 if about.not_empty else None,
            "minItems": about.at_least if rule.items is not None and about.at_least else None,
            "maxItems": about.at_most if rule.items is not None and about.at_most else None,
        }
        schema |= {name: limit for name, limit in limits.items() if limit is not None}
        if rule.items is not None:
            schema["items"] = self.schema(rule.items)
        if rule.keys is not None:
            schema |= self._known_keys(rule)
        elif rule.values is not None:
            schema |= self._named_entries(rule, rule.values)
        if self.for_text:
            schema |= _annotations(rule)
        return schema

    def _types(self, rule: ValueRule) -> tuple[str, ...]:
        """Return the types of JSON; a reference in place of a number is a string."""
        return (*rule.kinds, "string") if self._may_refer(rule) else rule.kinds

    def _may_refer(self, rule: ValueRule) -> bool:
        """Return whether a reference stands in place of a number or a truth value."""
        alone = len(rule.kinds) == 1 and rule.kinds[0] in _SCALAR_NAMES and rule.const is None
        return alone and self.for_text

    def _known_keys(self, rule: ValueRule) -> Schema:
        keys = rule.keys or {}
        schema: Schema = {
            "properties": {
                name: self.schema(below, removable=name != "r2bspec")
                for name, below in keys.items()
            },
            "additionalProperties": False,
            "patternProperties": {"^x-": {"description": "Ignored."}},
        }
        required = list(rule.required_unless(live=self.live, calls=self.calls))
        if required and "extends" in keys and self.for_text:
            # Required keys may come from the extended entry.
            needed = {"if": {"not": {"required": ["extends"]}}, "then": {"required": required}}
            return schema | needed
        return schema | ({"required": required} if required else {})

    def _named_entries(self, rule: ValueRule, values: ValueRule) -> Schema:
        about = rule.about
        schema: Schema = {"additionalProperties": self.schema(values, removable=True)}
        if rule.names is not None:
            schema["propertyNames"] = self._pattern(rule.names, or_reference=about.topics)
        if about.at_least:
            schema["minProperties"] = about.at_least
        if about.at_most and rule.items is None:
            schema["maxProperties"] = about.at_most
        return schema

    def _text(self, rule: ValueRule) -> Schema:
        """Return what a text must be like."""
        if rule.is_choice:
            words: Schema = {"enum": list(rule.words)}
            return {"anyOf": [words, {"pattern": _WHOLE_REFERENCE}]} if self.for_text else words
        if self._may_refer(rule):
            message = f"{_SCALAR_NAMES[rule.kinds[0]]}, or $(var name)"
            return {"pattern": _WHOLE_REFERENCE, "patternErrorMessage": message}
        if rule.quantity is not None and not self.for_text:
            parsed: Schema = {"format": text_format(rule)}
            return {"anyOf": [{"enum": list(rule.words)}, parsed]} if rule.words else parsed
        if rule.quantity is not None:
            pattern, message = _quantity(rule)
        elif rule.pattern is not None:
            pattern, message = rule.pattern.pattern, rule.pattern.message
        elif rule.words:
            pattern, message = "", f"one of {', '.join(rule.words)}, or a map"
        else:
            return {}
        if rule.words:
            only = f"^(?:{'|'.join(rule.words)})$"
            pattern = f"(?:{pattern})|{only}" if pattern else only
        return self._pattern(NamePattern(pattern, "", message), or_reference=True)

    def _pattern(self, form: NamePattern, *, or_reference: bool = False) -> Schema:
        if not self.for_text:
            return {"pattern": form.exact}
        pattern = f"(?:{form.pattern})|{_REFERENCE}" if or_reference else form.pattern
        return {"pattern": pattern, "patternErrorMessage": form.message}


def text_format(rule: ValueRule) -> str:
    """Return the name of the format of a quantity or a requirement in a resolved document."""
    kind = rule.quantity.kind if rule.quantity is not None else ""
    return f"positive {kind}" if rule.about.positive else kind


def _annotations(rule: ValueRule) -> Schema:
    """Return what editors show and offer."""
    schema: Schema = {"default": rule.shown_default} if rule.shown_default is not None else {}
    schema["examples"] = list(rule.about.examples)
    if rule.snippets:
        schema["defaultSnippets"] = list(rule.snippets)
    return schema


def _quantity(rule: ValueRule) -> tuple[str, str]:
    """Return the pattern of a quantity or a requirement, and a message."""
    kind = rule.quantity
    if kind is None or not issubclass(kind, Quantity):
        example = "latency.p99 < 50 ms, or sustained"
        return _REQUIREMENT, f"a requirement is 'metric op bound', such as {example}"
    more_than_zero = r"(?=[\d.]*[1-9])" if rule.about.positive else ""
    return (
        rf"^\s*{more_than_zero}{_NUMBER}\s*(?:{'|'.join(kind.units)})\s*$",
        f"a {kind.kind} is a number with a unit, such as {kind.example}",
    )
