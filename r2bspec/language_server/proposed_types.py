"""Message types that can be written: that of the topic first, then those that are known."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from lsprotocol import types

from r2bspec.check.check_context import Context
from r2bspec.check.installed_packages import installed_message_types
from r2bspec.diagnostics import Path
from r2bspec.language.located_tree import ScalarNode, lookup
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.cursor_context import CursorContext
from r2bspec.language_server.proposals import Proposal
from r2bspec.wiring.name_resolution import expand


def message_types(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """Message types: of the topic in the same map, of the spec, of this machine."""
    known = analysis.known
    if known is not None:
        owner = context.path[:-1]
        for used in dict.fromkeys(_of_topics(known, owner, _topics_beside(analysis, owner))):
            yield _proposal(used, "of this topic", 1)
        ends = [each for phase in known.wiring.phases for each in phase.endpoints]
        for used in dict.fromkeys(each.type for each in ends if each.type):
            yield _proposal(used, "used in this spec", 5)
    for name in sorted(installed_message_types()):
        yield _proposal(name, "installed", 600)
    for name in _common_types():
        yield _proposal(name, "", 610)


def _proposal(name: str, detail: str, order: int) -> Proposal:
    return Proposal(name, detail, kind=types.CompletionItemKind.Struct, order=order)


def _topics_beside(analysis: Analysis, owner: Path) -> Iterator[str]:
    """The topics of the input or the monitor whose type is written."""
    if owner[:2] == ("playback", "inputs"):
        yield str(owner[-1])
    tree = analysis.loaded.tree
    for key in ("from", "topic"):
        node = lookup(tree, (*owner, key)) if tree is not None else None
        if isinstance(node, ScalarNode):
            yield node.text


def _of_topics(known: Context, owner: Path, topics: Iterator[str]) -> Iterator[str]:
    """The types of topics, without what the entry that is written says itself."""
    names = {expand(each, "", known.wiring.namespace) for each in topics if each}
    for phase in known.wiring.phases:
        for end in phase.endpoints:
            if end.topic in names and end.type and owner not in {end.path, end.path[: len(owner)]}:
                yield end.type


@cache
def _common_types() -> tuple[str, ...]:
    from r2bspec.check.message_types import common_types

    return tuple(sorted(common_types()))
