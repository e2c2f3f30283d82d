"""One pass from a located tree to a `Spec`, or to everything that is wrong with it.

The tree is read by the rules of the language (`r2bspec.language.declaration`), and each part
becomes a value of its type as soon as it is read: a text is parsed to a quantity, a word is
expanded to the record that it stands for, a map becomes a record. What a rule refuses is a
`Violation`; it knows the rule, the place in the document, and so everything that a message needs.
Messages are made only where there is something to say, by `r2bspec.language.explain_violations`.

A value that is unknown, because a variable or an alias failed, violates nothing: the reason has
been reported. It is `INVALID` all the same, and so is everything that contains it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec

from r2bspec.diagnostics import Diagnostic, Edit, Path, Related, Span, format_path
from r2bspec.language.declaration import Record, ValueRule, language
from r2bspec.language.document import MAX_PROBLEMS, Source
from r2bspec.language.located_tree import (
    ListNode,
    MapNode,
    ScalarNode,
    TreeNode,
    UnknownNode,
    lookup,
    span_at,
    text_of,
    to_plain,
)
from r2bspec.language.spec import Spec

INVALID: Final = msgspec.UNSET
"""In place of a value that could not be read."""

_MAX_VIOLATIONS: Final = 2 * MAX_PROBLEMS
"""One mistake may violate several rules."""

_TYPES: Final[Mapping[type, frozenset[str]]] = {
    str: frozenset({"string"}),
    int: frozenset({"integer", "number"}),
    float: frozenset({"number"}),
    bool: frozenset({"boolean"}),
}
"""The types of JSON that a value can have. Unlike in JSON Schema, 1.0 is no integer: it is none in
ROS parameters and in YAML either."""


class Violation(msgspec.Struct, frozen=True):
    """A place in the document, and what it violates of its rule.

    Attributes:
        path: of the value, or of the map whose key is wrong.
        kind: ``type``, ``words``, ``const``, ``pattern``, ``minimum``, ``maximum``, ``empty``,
            ``quantity``, ``names`` for a key of a wrong form, ``unknown`` for unknown keys,
            ``required`` for missing keys, or ``at_most`` for too many entries.
        node: the value.
        key: the key, of kind ``names``.
    """

    path: Path
    kind: str
    rule: ValueRule
    node: TreeNode
    root: TreeNode
    sources: Mapping[str, Source]
    key: str = ""

    @property
    def name(self) -> str:
        """The path as shown in messages."""
        return f"'{format_path(self.path)}'" if self.path else "the document"

    @property
    def value(self) -> Any:
        """The value as plain data."""
        return to_plain(self.node)

    @property
    def required(self) -> tuple[str, ...]:
        """The keys that the map must have."""
        return required_keys(self.rule, self.root)

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
        """A diagnostic at the value, or at `span`.

        `repair` becomes an edit of the value, unless the value comes from a variable: then the
        variable would have to be edited, which may be used elsewhere.
        """
        place = span or span_at(self.root, self.path)
        edit = Edit(place, repair) if repair else None
        if span is None and isinstance(self.node, ScalarNode) and self.node.origin is not None:
            related += (self.node.origin,)
            edit = None
        path = self.path if path is None else path
        return Diagnostic.error(
            code, message, place, help_text, path=path, related=related, edit=edit
        )


def read_spec(
    root: TreeNode, sources: Mapping[str, Source]
) -> tuple[Spec | None, Sequence[Violation]]:
    """The typed value of a document, or what it violates; neither if only unknown values are wrong.

    Args:
        root: the document after substitution.
        sources: the texts that its places point into.
    """
    spec, violations = read_value(root, language(), sources)
    return (spec if isinstance(spec, Spec) else None), violations


def read_value(
    root: TreeNode,
    rule: ValueRule,
    sources: Mapping[str, Source] | None = None,
    path: Path = (),
) -> tuple[Any, Sequence[Violation]]:
    """The value of a tree by any rule, or `INVALID`; and what it violates.

    Args:
        root: the tree.
        rule: of its value.
        sources: the texts that its places point into.
        path: what messages call the value.
    """
    reader = _Reader(root, sources or {})
    return reader.read(root, rule, path), reader.violations


def required_keys(rule: ValueRule, root: TreeNode) -> tuple[str, ...]:
    """The keys that a map of a document must have: fewer where nothing is played, or called."""
    # What is called is monitored; what is played is loaded.
    calls = lookup(root, ("playback", "calls")) is not None
    mode = text_of(lookup(root, ("playback", "mode")))
    live = lookup(root, ("playback", "inputs")) is None if calls else mode == "live"
    return rule.required_unless(live=live, calls=calls)


class _Reader:
    def __init__(self, root: TreeNode, sources: Mapping[str, Source]) -> None:
        self.violations: list[Violation] = []
        self._root = root
        self._sources = sources

    def read(self, node: TreeNode, rule: ValueRule, path: Path) -> Any:
        """The value of a node, or `INVALID`."""
        if type(node) is ScalarNode:
            return self._scalar(node, rule, path)
        if type(node) is UnknownNode:
            return INVALID
        if not rule.kinds:
            return self._anything(node, rule, path)
        if type(node) is MapNode:
            if rule.keys is not None:
                return self._record(node, rule, path)
            if rule.values is not None:
                return self._name_map(node, rule, rule.values, path)
        elif type(node) is ListNode and rule.items is not None:
            return self._list(node, rule, rule.items, path)
        return self._refuse("quantity" if rule.is_parsed else "type", node, rule, path)

    def _anything(self, node: TreeNode, rule: ValueRule, path: Path) -> Any:
        """A list or a map of any kind, in which only null is no value."""
        if isinstance(node, MapNode):
            entries = {
                key: self.read(entry.value, rule, (*path, key))
                for key, entry in node.entries.items()
            }
            return INVALID if INVALID in entries.values() else entries
        items = node.items if isinstance(node, ListNode) else ()
        values = [self.read(item, rule, (*path, index)) for index, item in enumerate(items)]
        return INVALID if INVALID in values else values

    def _refuse(self, kind: str, node: TreeNode, rule: ValueRule, path: Path, key: str = "") -> Any:
        if len(self.violations) < _MAX_VIOLATIONS:
            self.violations.append(
                Violation(path, kind, rule, node, self._root, self._sources, key)
            )
        return INVALID

    def _scalar(self, node: ScalarNode, rule: ValueRule, path: Path) -> Any:
        value = node.value
        kinds = rule.kinds
        if rule.quantity is not None and (type(value) is str or rule.is_parsed):
            return self._quantity(node, rule, path)
        if type(value) is str and "string" in kinds:
            if rule.allows_text(value):
                record = rule.record
                return value if record is None or record.word is None else record.from_word(value)
            kind = "words" if rule.words else "pattern" if rule.pattern else "empty"
            return self._refuse(kind, node, rule, path)
        if value is None or (kinds and _TYPES[type(value)].isdisjoint(kinds)):
            return self._refuse("type", node, rule, path)
        if rule.const is not None and value != rule.const:
            return self._refuse("const", node, rule, path)
        if type(value) is int or type(value) is float:
            about = rule.about
            if about.minimum is not None and value < about.minimum:
                return self._refuse("minimum", node, rule, path)
            if about.maximum is not None and value > about.maximum:
                return self._refuse("maximum", node, rule, path)
        return node.text if rule.about.as_text else value

    def _quantity(self, node: ScalarNode, rule: ValueRule, path: Path) -> Any:
        text = node.value
        if text in rule.words:
            return text
        if isinstance(text, str) and rule.quantity is not None:
            try:
                parsed = rule.quantity.parse(text)
            except ValueError:
                return self._refuse("quantity", node, rule, path)
            if not rule.about.positive or parsed.is_positive:
                return parsed
        return self._refuse("quantity", node, rule, path)

    def _record(self, node: MapNode, rule: ValueRule, path: Path) -> Any:
        keys, entries, record = rule.keys, node.entries, rule.record
        assert keys is not None and record is not None  # noqa: S101, PT018 - the caller looked
        values: dict[str, Any] = {}
        invalid = unknown = False
        for name, entry in entries.items():
            below = keys.get(name)
            if below is None:
                unknown = True
                continue
            value = self.read(entry.value, below, (*path, name))
            if value is INVALID:
                invalid = True
            elif not below.about.loader:
                values[below.field] = value
        if unknown:
            self._refuse("unknown", node, rule, path)
        lacks = any(name not in entries for name in rule.required)
        if lacks and any(name not in entries for name in required_keys(rule, self._root)):
            self._refuse("required", node, rule, path)
            invalid = True
        if invalid or unknown:
            return INVALID
        plain = record.from_keys.__func__ is _AS_WRITTEN  # type: ignore[attr-defined]
        return record(**values) if plain else record.from_keys(values)

    def _name_map(self, node: MapNode, rule: ValueRule, below: ValueRule, path: Path) -> Any:
        values: dict[str, Any] = {}
        invalid = self._is_of_wrong_size(node, len(node.entries), rule, path)
        search = rule.names.search if rule.names is not None else None
        for name, entry in node.entries.items():
            if search is not None and search(name) is None:
                invalid = True
                if entry.key_resolved:
                    self._refuse("names", node, rule, path, name)
            value = self.read(entry.value, below, (*path, name))
            if value is INVALID:
                invalid = True
            values[name] = value
        return INVALID if invalid else values

    def _list(self, node: ListNode, rule: ValueRule, below: ValueRule, path: Path) -> Any:
        invalid = self._is_of_wrong_size(node, len(node.items), rule, path)
        values = [self.read(item, below, (*path, index)) for index, item in enumerate(node.items)]
        return INVALID if invalid or INVALID in values else rule.make(values)

    def _is_of_wrong_size(
        self, node: MapNode | ListNode, size: int, rule: ValueRule, path: Path
    ) -> bool:
        about = rule.about
        if size < about.at_least:
            self._refuse("empty", node, rule, path)
            return True
        counted = ListNode if rule.items is not None else MapNode
        if about.at_most and size > about.at_most and isinstance(node, counted):
            self._refuse("at_most", node, rule, path)
            return True
        return False


_AS_WRITTEN: Final = Record.from_keys.__func__  # type: ignore[attr-defined]
