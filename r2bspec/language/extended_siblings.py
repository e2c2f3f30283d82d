"""`extends` in maps of named entries: an entry that extends another of the same map."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from r2bspec.diagnostics import Path, Related, did_you_mean, format_path
from r2bspec.diagnostics.quote import quote
from r2bspec.language.diagnostic_collector import DiagnosticCollector
from r2bspec.language.extended_files import overlay
from r2bspec.language.located_tree import (
    Entry,
    MapNode,
    ScalarNode,
    TreeNode,
    lookup,
    replace_at,
    without,
)

KEY = "extends"
SECTIONS: tuple[Path, ...] = (
    ("preprocessors",),
    ("containers",),
    ("graph", "nodes"),
    ("monitors",),
    ("slos",),
)
"""Maps whose entries may extend each other."""
MAX_CHAIN_LENGTH = 50
"""Entries in a chain, each of which extends the next."""


class SiblingsResult(msgspec.Struct):
    """The tree with all entries expanded, the problems, and the origins of entries.

    Attributes:
        incomplete: entries that extend something invalid, whose missing keys are unknown.
    """

    tree: TreeNode
    problems: DiagnosticCollector = msgspec.field(default_factory=DiagnosticCollector)
    incomplete: set[Path] = msgspec.field(default_factory=set)
    origins: dict[Path, tuple[Related, ...]] = msgspec.field(default_factory=dict)


def extend_siblings(root: TreeNode) -> SiblingsResult:
    """Expand every entry that extends a sibling."""
    result = SiblingsResult(root)
    for section in SECTIONS:
        entries = lookup(root, section)
        if isinstance(entries, MapNode) and any(
            _extends_sibling(e.value) for e in _values(entries)
        ):
            done = _Section(result, section, entries).expanded()
            result.tree = replace_at(result.tree, section, done)
    return result


class _Section:
    def __init__(self, result: SiblingsResult, section: Path, entries: MapNode) -> None:
        self._result = result
        self._section = section
        self._entries = entries
        self._failed: set[str] = set()
        self._done: dict[str, MapNode] = {}
        self._depth: dict[str, int] = {}

    def expanded(self) -> MapNode:
        entries = {
            name: Entry(entry.key_span, self._resolved(name), entry.key_resolved)
            if _extends_sibling(entry.value)
            else entry
            for name, entry in self._entries.entries.items()
        }
        self._result.incomplete |= {(*self._section, name) for name in self._failed}
        return MapNode(entries, self._entries.span)

    def _resolved(self, name: str) -> MapNode:
        """The entry merged over the entries that it extends, the most distant first."""
        chain = [name]
        while chain[-1] not in self._done:
            base = self._base(chain)
            if base is None:
                break
            chain.append(base)
        broken = [index for index, each in enumerate(chain) if each in self._failed]
        self._failed.update(chain[: max(broken, default=-1) + 1])
        done = self._done.get(chain[-1])
        depth = self._depth.get(chain[-1], 0)
        for each in reversed(chain):
            if each in self._done:
                continue
            own = self._map(each)
            named = own.entries.get(KEY)
            if named is not None and _extends_sibling(own):
                own = without(own, KEY)
            done = own if done is None else overlay(without(done, KEY), own)
            self._done[each] = done
            self._depth[each] = depth = depth + 1
        return self._done[name]

    def _base(self, chain: list[str]) -> str | None:
        """The sibling that the last of a chain extends; None at its end, or if it is invalid."""
        entry = self._map(chain[-1]).entries.get(KEY)
        if entry is None or not isinstance(entry.value, ScalarNode):
            return None
        base, span = entry.value.value, entry.value.span
        if not isinstance(base, str):
            return None
        where = quote(format_path(self._section))
        if base not in self._entries.entries or not isinstance(
            self._entries.entries[base].value, MapNode
        ):
            close = did_you_mean(base, self._entries.entries)
            others = [each for each in self._entries.entries if each != chain[-1]]
            known = "known entries: " + ", ".join(others[:12]) if others else "there are no others"
            self._result.problems.error(
                "R2B136",
                f"{where} has no entry {quote(base)} to extend",
                span,
                f"did you mean '{close}'? {known}" if close and close != chain[-1] else known,
            )
            self._failed.add(chain[-1])
            return None
        self._result.origins[(*self._section, chain[-1])] = (
            Related(f"'{chain[-1]}' extends '{base}' here", span),
        )
        if base in chain or len(chain) + self._depth.get(base, 0) >= MAX_CHAIN_LENGTH:
            circle = base in chain
            message = (
                f"{quote(base)} extends itself, directly or through others"
                if circle
                else f"more than {MAX_CHAIN_LENGTH} entries extend each other"
            )
            self._result.problems.error(
                "R2B135", message, span, "remove one 'extends' of this chain"
            )
            self._failed.add(chain[-1])
            return None
        return base

    def _map(self, name: str) -> MapNode:
        value = self._entries.entries[name].value
        return value if isinstance(value, MapNode) else MapNode({}, value.span)


def _values(entries: MapNode) -> Iterator[Entry]:
    yield from entries.entries.values()


def _extends_sibling(node: TreeNode) -> bool:
    """Whether an entry names a sibling; wrong types are reported by the schema."""
    entry = node.entries.get(KEY) if isinstance(node, MapNode) else None
    value = entry.value if entry is not None else None
    return isinstance(value, ScalarNode) and isinstance(value.value, str) and bool(value.value)
