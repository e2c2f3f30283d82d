"""Limits on the size of a graph. They are far above every real one, and bound what rules do."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.diagnostics import Diagnostic, Path, Severity
from r2bspec.language.located_tree import TreeNode, span_at
from r2bspec.language.spec import Spec

MAX_ENTRIES = 5000
"""Nodes, inputs or monitors of a spec."""

MAX_REQUIREMENTS = 10_000
"""Requirements of all objectives together."""

MAX_PARAMETER_SOURCES = 100
"""Parameter files and maps of parameters that one node lists."""


def exceeded_limits(spec: Spec, tree: TreeNode) -> list[Diagnostic]:
    """An error for each limit that a spec exceeds."""
    return [
        Diagnostic(
            "R2B129",
            Severity.ERROR,
            f"{number:,} {what}; the limit is {limit:,}",
            span_at(tree, path, key=True),
            path=path,
            help="split the spec",
        )
        for path, what, number, limit in _counts(spec)
        if number > limit
    ]


def _counts(spec: Spec) -> Iterator[tuple[Path, str, int, int]]:
    yield ("graph", "nodes"), "nodes", len(spec.graph.nodes), MAX_ENTRIES
    yield ("preprocessors",), "preprocessors", len(spec.preprocessors), MAX_ENTRIES
    yield ("playback", "inputs"), "inputs", len(spec.playback.inputs), MAX_ENTRIES
    yield ("monitors",), "monitors", len(spec.monitors), MAX_ENTRIES
    yield ("data_loader", "topics"), "topics", len(spec.data_loader.topics), MAX_ENTRIES
    requirements = sum(len(each.require) for each in spec.slos.values())
    yield ("slos",), "requirements", requirements, MAX_REQUIREMENTS
    for section, nodes in (
        (("graph", "nodes"), spec.graph.nodes),
        (("preprocessors",), spec.preprocessors),
    ):
        for name, node in nodes.items():
            path = (*section, name, "parameters")
            yield path, "entries", len(node.parameter_sources), MAX_PARAMETER_SOURCES
