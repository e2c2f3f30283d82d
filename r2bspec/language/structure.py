"""The structure of a resolved document: jsonschema decides, and what is valid becomes a value.

The schema is generated from the declaration (`r2bspec.language.json_schema`). What it refuses is a
`Violation`: the error of jsonschema with the rule of its place and the located value, so everything
that a message needs. `r2bspec.language.explain_violations` turns violations into messages.

A value that is unknown, because a variable or an alias failed, violates nothing: the reason has
been reported.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, partial
from itertools import islice
from typing import TYPE_CHECKING, Any, Final

import msgspec

from r2bspec.diagnostics import Diagnostic, Edit, Path, Related, Span, format_path
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.declaration import ValueRule, language
from r2bspec.language.document import MAX_PROBLEMS, Source
from r2bspec.language.json_schema import resolved_schema
from r2bspec.language.located_tree import (
    ListNode,
    MapNode,
    ScalarNode,
    TreeNode,
    UnknownNode,
    child,
    entries_of,
    lookup,
    span_at,
    text_of,
    to_plain,
)
from r2bspec.language.quantities import QUANTITIES, Quantity

if TYPE_CHECKING:
    from jsonschema import FormatChecker
    from jsonschema.protocols import Validator

INVALID: Final = msgspec.UNSET
"""In place of a value that could not be read."""

_MAX_ERRORS: Final = 2 * MAX_PROBLEMS
"""One mistake may have several errors."""


class Violation(msgspec.Struct, frozen=True):
    """A place in the document, and how it violates its rule.

    Attributes:
        path: the path of the value, or of the map whose key is wrong, as messages show it.
        inner: the same below `root`.
        keyword: the keyword of the schema; ``propertyNames`` for a key of a wrong form.
        node: the value.
        limit: the value of the keyword: for ``required`` the keys that the map must have.
        key: the key of a wrong form.
    """

    path: Path
    inner: Path
    keyword: str
    rule: ValueRule
    node: TreeNode
    root: TreeNode
    sources: Mapping[str, Source]
    limit: Any = None
    key: str = ""

    @property
    def name(self) -> str:
        """The path as shown in messages."""
        return f"'{format_path(self.path)}'" if self.path else "the document"

    def key_span(self, *steps: str | int) -> Span:
        """Return the place of the key of the value, or of the value at further steps."""
        return span_at(self.root, (*self.inner, *steps), key=True)

    @property
    def value(self) -> Any:
        """The value as plain data."""
        return to_plain(self.node)

    def error(
        self,
        code: str,
        message: str,
        help_text: str = "",
        *,
        span: Span | None = None,
        path: Path | None = None,
        repair: str = "",
        related: tuple[Related, ...] = (),
    ) -> Diagnostic:
        """Return a diagnostic at the value, or at `span`.

        `repair` becomes an edit of the value, unless the value comes from a variable: then the
        variable would have to be edited, which may be used elsewhere.
        """
        place = span or span_at(self.root, self.inner)
        edit = Edit(place, repair) if repair else None
        if span is None and isinstance(self.node, ScalarNode) and self.node.origin is not None:
            related += (self.node.origin,)
            edit = None
        path = self.path if path is None else path
        return Diagnostic.error(
            code, message, place, help_text, path=path, related=related, edit=edit
        )


def read_value(
    root: TreeNode,
    rule: ValueRule | None = None,
    sources: Mapping[str, Source] | None = None,
    path: Path = (),
) -> tuple[Any, Sequence[Violation]]:
    """Return the value of a tree, or `INVALID`, and its violations.

    Args:
        root: the tree.
        rule: the rule of its value; by default that of a document.
        sources: the texts that its places point into.
        path: what messages call the value.
    """
    reader = _Reader(root, language() if rule is None else rule, sources or {}, path)
    if not reader.is_valid():
        return INVALID, reader.violations
    return _value(root, reader.rule), ()


def explain(violations: Sequence[Violation]) -> list[Diagnostic]:
    """Return one diagnostic for each mistake among violations."""
    if not violations:
        return []
    # Imported only where there is something to explain.
    from r2bspec.language.explain_violations import explain_violations

    return explain_violations(violations)


class _Reader:
    def __init__(
        self, root: TreeNode, rule: ValueRule, sources: Mapping[str, Source], path: Path
    ) -> None:
        self.rule = rule
        self.violations: list[Violation] = []
        self._root = root
        self._sources = sources
        self._path = path

    def is_valid(self) -> bool:
        """Return True if the schema accepts the tree; otherwise add what it violates."""
        plain = to_plain(self._root)
        # What is called is monitored; what is played is loaded.
        calls = lookup(self._root, ("playback", "calls")) is not None
        mode = text_of(lookup(self._root, ("playback", "mode")))
        live = lookup(self._root, ("playback", "inputs")) is None if calls else mode == "live"
        validator = _validator(self.rule, live=live, calls=calls)
        if validator.is_valid(plain):
            return True
        met: set[tuple[Path, str, str]] = set()
        for error in islice(validator.iter_errors(plain), _MAX_ERRORS):
            inner, keyword, key = tuple(error.absolute_path), str(error.validator), ""
            if "propertyNames" in error.absolute_schema_path:
                keyword, key = "propertyNames", str(error.instance)
            # A value of the wrong type has no form either.
            if met.isdisjoint({(inner, keyword, key), (inner, "type", "")}):
                met.add((inner, keyword, key))
                self._add(inner, keyword, error.validator_value, key)
        # The errors of a map come in any order.
        self.violations.sort(key=_place)
        return False

    def _add(self, path: Path, keyword: str, limit: Any = None, key: str = "") -> None:
        node: TreeNode | None = self._root
        rule: ValueRule | None = self.rule
        for step in path:
            node = child(node, step)
            # Below a value of any form there is no rule of its own.
            rule = (rule.below(step) or rule) if rule is not None else None
        if node is None or rule is None or isinstance(node, UnknownNode):
            return
        if key and not entries_of(node)[key].key_resolved:
            return
        self.violations.append(
            Violation(
                (*self._path, *path),
                path,
                keyword,
                rule,
                node,
                self._root,
                self._sources,
                limit,
                key,
            )
        )


def _place(violation: Violation) -> tuple[int, int, list[str], str]:
    span = violation.node.span
    return span.line, span.column, [str(step) for step in violation.path], violation.key


def _value(node: TreeNode, rule: ValueRule) -> Any:
    """Return the value of a valid tree."""
    if isinstance(node, MapNode):
        if rule.keys is not None and rule.record is not None:
            keys = rule.keys
            return rule.record.from_keys(
                {
                    keys[name].field: _value(entry.value, keys[name])
                    for name, entry in node.entries.items()
                    if name in keys and not keys[name].about.loader
                }
            )
        below = rule.values or rule
        return {key: _value(entry.value, below) for key, entry in node.entries.items()}
    if isinstance(node, ListNode):
        items = [_value(item, rule.items or rule) for item in node.items]
        return rule.make(items) if rule.items is not None else items
    if not isinstance(node, ScalarNode):
        raise TypeError(f"an unknown value at {node.span} was found valid")
    text = node.value
    if isinstance(text, str) and text not in rule.words and rule.quantity is not None:
        return rule.quantity.parse(text)
    if isinstance(text, str) and rule.record is not None and rule.record.word is not None:
        return rule.record.from_word(text)
    return node.text if rule.about.as_text else node.value


@cache
def _validator(rule: ValueRule, *, live: bool, calls: bool) -> Validator:
    """Return the validator of a rule, compiled once."""
    from jsonschema import Draft7Validator, validators

    # In YAML and in ROS parameters, 1.0 is no integer.
    types = Draft7Validator.TYPE_CHECKER.redefine("integer", lambda _, value: type(value) is int)
    strict: Any = validators.extend(Draft7Validator, type_checker=types)  # type: ignore[no-untyped-call]
    schema = resolved_schema(rule, live=live, calls=calls)
    validator: Validator = strict(schema, format_checker=_formats())
    return validator


@cache
def _formats() -> FormatChecker:
    """Return the formats of quantities and requirements: texts that their classes parse."""
    from jsonschema import FormatChecker

    checker = FormatChecker(())
    kinds: tuple[type[Quantity] | type[Requirement], ...] = (*QUANTITIES.values(), Requirement)
    for kind in kinds:
        parsed = partial(_is_parsed, kind, positive=False)
        checker.checks(kind.kind, raises=ValueError)(parsed)
        positive = partial(_is_parsed, kind, positive=True)
        checker.checks(f"positive {kind.kind}", raises=ValueError)(positive)
    return checker


def _is_parsed(kind: type[Quantity] | type[Requirement], text: object, *, positive: bool) -> bool:
    """Return True if a value is no text, or one that a class parses.

    Raises:
        ValueError: the class does not parse it.
    """
    if not isinstance(text, str):
        return True
    value = kind.parse(text)
    return value.is_positive or not positive
