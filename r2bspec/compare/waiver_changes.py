"""Waivers (`r2bspec.diagnostics.waivers`) that only one of two documents has.

A waiver is the same if it waives the same code on the same key, so that it may move with its line
and give another reason. On a line without a key, as in a text that another file replaces, it is the
same if it gives the same reason.
"""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.compare.gate_change import GateChange
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.diagnostics.diagnostic import Path, Span
from r2bspec.diagnostics.waivers import Waiver, effective_waivers
from r2bspec.language.load_spec import LoadedSpec
from r2bspec.language.located_tree import ListNode, MapNode, TreeNode

_WaiverKey = tuple[str, Path | str]


def waiver_changes(base: LoadedSpec, head: LoadedSpec) -> Iterator[GateChange]:
    """New waivers, which make a gate weaker, and waivers that are gone."""
    before, after = _waivers(base), _waivers(head)
    for key, waiver in after.items():
        if key not in before:
            yield _change(waiver, "", waiver.reason, waiver.span)
    for key, waiver in before.items():
        if key not in after:
            yield _change(waiver, waiver.reason, "", None)


def _change(waiver: Waiver, before: str, after: str, span: Span | None) -> GateChange:
    return GateChange(f"waiver {waiver.code}", (), before, after, weaker=bool(after), span=span)


def _waivers(loaded: LoadedSpec) -> dict[_WaiverKey, Waiver]:
    slugs = {code: page.slug for code, page in all_pages().items()}
    waivers = list(effective_waivers(loaded.texts, slugs))
    paths = _paths_by_line(loaded.tree) if waivers and loaded.tree is not None else {}
    return {
        (each.code, paths.get((each.span.file, each.line), each.reason)): each for each in waivers
    }


def _paths_by_line(root: TreeNode) -> dict[tuple[str, int], Path]:
    """The path of the first key, or item of a list, on each line of each file."""
    paths: dict[tuple[str, int], Path] = {}

    def visit(node: TreeNode, path: Path) -> None:
        if isinstance(node, MapNode):
            for name, entry in node.entries.items():
                span = entry.key_span
                paths.setdefault((span.file, span.line), (*path, name))
                visit(entry.value, (*path, name))
        elif isinstance(node, ListNode):
            for index, item in enumerate(node.items):
                paths.setdefault((item.span.file, item.span.line), (*path, index))
                visit(item, (*path, index))

    visit(root, ())
    return paths
