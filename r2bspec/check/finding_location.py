"""Findings at paths, and differences of a run, as diagnostics at lines and columns.

``r2bspec validate`` knows the interface of a node only if it is described; a run observes the node
itself. Both report the same error with the same code at the same place.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding
from r2bspec.diagnostics.diagnostic import (
    Certainty,
    Diagnostic,
    Edit,
    Path,
    Related,
    Severity,
    Span,
)
from r2bspec.language.located_tree import ScalarNode, lookup
from r2bspec.plan.wiring.name_resolution import expand
from r2bspec.plan.wiring.wiring import NodeWiring
from r2bspec.record.run_record import Difference

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec


def to_diagnostic(
    finding: Finding, code: str, severity: Severity, loaded: LoadedSpec
) -> Diagnostic:
    """The diagnostic of a finding; code and severity of the rule are the defaults."""
    span = _span(finding, loaded)
    related = [
        Related(pointer.message, loaded.span(pointer.path, key=pointer.key))
        for pointer in finding.related
    ]
    return Diagnostic(
        code=finding.code or code,
        severity=Severity(finding.severity or severity),
        message=finding.message,
        span=span,
        path=finding.path,
        help=finding.help,
        related=tuple(related + ([] if finding.key else _origin(finding.path, loaded))),
        edit=_edit(finding, span, loaded),
        certainty=Certainty.ENVIRONMENT if finding.machine_dependent else Certainty.CERTAIN,
    )


def _span(finding: Finding, loaded: LoadedSpec) -> Span:
    if finding.part is not None:
        return loaded.span_inside(finding.path, *finding.part)
    return loaded.span(finding.path, key=finding.key)


def _origin(path: Path, loaded: LoadedSpec) -> list[Related]:
    """Where the variable is set from which the value at `path` comes."""
    node = lookup(loaded.tree, path) if loaded.tree is not None else None
    return [node.origin] if isinstance(node, ScalarNode) and node.origin is not None else []


def _edit(finding: Finding, span: Span, loaded: LoadedSpec) -> Edit | None:
    """The replacement, if the text at `span` is exactly the text to replace."""
    if finding.replacement is None or loaded.tree is None or span.line != span.end_line:
        return None
    node = lookup(loaded.tree, finding.path)
    source = loaded.sources.get(span.file)
    if source is None or not isinstance(node, ScalarNode) or node.origin is not None:
        return None
    offset, length = finding.part or (0, len(node.text))
    written = source.line(span.line)[span.column - 1 : span.end_column - 1]
    exact = written == node.text[offset : offset + length]
    return Edit(span, finding.replacement) if exact else None


def differences_to_diagnostics(
    differences: Iterable[Difference], loaded: LoadedSpec
) -> tuple[Diagnostic, ...]:
    """The diagnostics of differences between a spec and the real graph, sorted by place.

    Args:
        differences: from the run.
        loaded: the document of the plan.
    """
    if loaded.spec is None:
        return ()
    context = Context(loaded, loaded.spec, offline=True)
    diagnostics = [
        to_diagnostic(
            Finding(message=difference.message, path=path, key=key, help=difference.help),
            difference.code,
            Severity.WARNING if difference.harmless else Severity.ERROR,
            loaded,
        )
        for difference in differences
        for path, key in [_path(difference, context)]
    ]
    return tuple(sorted(diagnostics, key=lambda diagnostic: diagnostic.sort_key))


def _path(difference: Difference, context: Context) -> tuple[Path, bool]:
    """The path of a difference, and whether it is about the key there."""
    node = next((node for _, node in context.nodes if node.name == difference.owner), None)
    if difference.part == "endpoint" or node is None:
        return _endpoint(difference, context, node)
    if difference.part == "remapping":
        return (*node.path, "remappings", difference.name), True
    if difference.part == "lifecycle":
        written = node.node.lifecycle is not None
        return ((*node.path, "lifecycle"), False) if written else (node.path, True)
    if difference.part == "node":
        return node.path, True
    if difference.part in {"executor", "plugin", "package"}:
        return (*node.path, difference.part), False
    path = context.parameter_path(node, difference.name)
    if path is not None:
        return path, True
    return ((*node.path, "parameters"), False) if node.node.parameters else (node.path, True)


def _endpoint(
    difference: Difference, context: Context, node: NodeWiring | None
) -> tuple[Path, bool]:
    """The place of the spec from which a node, the player or a monitor has this topic.

    If a node has another one instead because of a remapping, this is what is misspelt.
    """
    rules = [
        (*each.path, "remappings", before)
        for _, each in context.nodes
        for before, after in each.node.remappings.items()
        if difference.topic and expand(after, each.key, each.namespace) == difference.topic
    ]
    if len(rules) == 1:
        return rules[0], False
    ends = [
        endpoint
        for phase in context.wiring.phases
        for endpoint in phase.endpoints
        if endpoint.topic == difference.name
    ]
    own = [endpoint for endpoint in ends if endpoint.owner == difference.owner]
    for endpoint in own or ends:
        return endpoint.path, endpoint.topic_is_key
    return (node.path, True) if node is not None else ((), False)
