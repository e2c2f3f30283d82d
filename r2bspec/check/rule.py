"""The parts of rules: what a rule is, what it finds, and the parts of its messages.

A rule is a function with a code, in a module of `r2bspec.check.rules`::

    @rule("R2B616")
    def variable_unused(context: Context) -> Findings:
        # yields findings

Its name is the slug of its page (`r2bspec.diagnostics.code_pages`), which says everything else:
title, severity, reason and examples.

A finding names subjects, which link consequences to their cause (see `r2bspec.check.engine`). What
follows from the interface of a node is only as certain as the source of the interface:
`with_record` and `as_version_warning` say so.

Findings at paths, and differences of a run, become diagnostics at lines and columns here.
``r2bspec validate`` knows the interface of a node only if it is described; a run observes the node
itself. Both report the same error with the same code at the same place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Set
from typing import TYPE_CHECKING, Literal

import msgspec
from msgspec.structs import replace

from r2bspec.check.check_context import Context
from r2bspec.diagnostics.code_pages import Page, find_page
from r2bspec.diagnostics.diagnostic import (
    Certainty,
    Diagnostic,
    Edit,
    Path,
    Related,
    Severity,
    Span,
)
from r2bspec.diagnostics.quote import quoted_list, suggestion
from r2bspec.language.located_tree import ScalarNode, lookup
from r2bspec.plan.wiring.name_resolution import expand
from r2bspec.plan.wiring.node_interface import Interface, InterfaceSource
from r2bspec.plan.wiring.wiring import NodeWiring, PhaseWiring, WiredEndpoint
from r2bspec.record.run_record import Difference
from r2bspec.safe_io.file_search import near_path

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec


SeverityName = Literal["error", "warning", "info"]
"""A `r2bspec.diagnostics.diagnostic.Severity`, as rules write it."""


class Pointer(msgspec.Struct, frozen=True):
    """Another place of the spec that explains a finding: the value at `path`, or its key."""

    message: str
    path: Path
    key: bool = False


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """A problem that a rule has found.

    Attributes:
        message: what is wrong, without a full stop; names are in single quotes.
        path: the wrong value.
        key: whether the key at `path` is wrong, not the value.
        part: offset and length of the wrong part, in characters of the value's text.
        help: what to do.
        related: other places that explain it.
        replacement: a text that can safely replace the value, or its `part`.
        severity: if it differs from the rule's.
        machine_dependent: whether the result may differ on another machine.
        code: if it differs from the rule's, as for errors of bags.
        suppressed_by: the subjects of the finding; see `r2bspec.check.engine`.
        suppresses: the subjects that this finding explains.
    """

    message: str
    path: Path
    key: bool = False
    part: tuple[int, int] | None = None
    help: str = ""
    related: tuple[Pointer, ...] = ()
    replacement: str | None = None
    severity: SeverityName | None = None
    machine_dependent: bool = False
    code: str = ""
    suppressed_by: Set[str] = frozenset()
    suppresses: Set[str] = frozenset()


Findings = Iterator[Finding]
"""The result of a rule."""


class Rule(msgspec.Struct, frozen=True, kw_only=True):
    """A rule: its code, and the function that finds violations.

    Attributes:
        code: such as ``R2B204``.
        find: yields the findings; it may use everything in the context, and executes nothing.
        early: whether its findings suppress findings of rules with lower codes.
    """

    code: str
    find: Callable[[Context], Findings]
    early: bool = False

    @property
    def page(self) -> Page:
        """The page of the rule, with the severity of findings that have none of their own.

        Raises:
            LookupError: the code has no page.
        """
        page = find_page(self.code)
        if page is None:
            raise LookupError(f"{self.code} has no page")
        return page


def rule(code: str, *, early: bool = False) -> Callable[[Callable[[Context], Findings]], Rule]:
    """Make a function a rule; see `Rule` for the arguments."""

    def decorate(find: Callable[[Context], Findings]) -> Rule:
        return Rule(code=code, find=find, early=early)

    return decorate


MEASURE_FLOW = "flow"
"""The path of the messages from the playback inputs to the monitors."""

PREPROCESS_FLOW = "feed"
"""The path of the messages from the bag through the preprocessors to the playback inputs."""


def path_help(context: Context, path: str) -> str:
    """Return help for a path of a spec that leads to nothing."""
    base = context.loaded.base_dir
    return near_path(path, base) or f"paths are relative to the folder of the spec ({base})"


def flow_key(phase: str) -> str:
    """Return the path of the messages in a phase."""
    return PREPROCESS_FLOW if phase == "preprocess" else MEASURE_FLOW


def topic_key(phase: str, name: str) -> str:
    """Return the publishers and subscriptions of a topic, by its full name."""
    return f"topic:{phase}:{name}"


def value_key(path: Path) -> str:
    """Return a value of the document."""
    return f"value:{'.'.join(map(str, path))}"


def publisher_advice(context: Context, phase: PhaseWiring, topic: str) -> str:
    """Return advice on a topic without a publisher: use another, or state what nodes publish."""
    published = [context.relative_name(name) for name in phase.topics if phase.publishers(name)]
    advice = suggestion(context.relative_name(topic), published, "published topics")
    if not phase.possible_publishers:
        return advice
    unknown = phase.possible_publishers
    declaration = f"list the topics of {quoted_list(each.key for each in unknown)} under "
    declaration += f"'publishes:'{why_unknown(unknown)}"
    return f"{advice}; or {declaration}" if advice else declaration


_MAX_REASONS = 2


def why_unknown(nodes: Iterable[NodeWiring]) -> str:
    """Return why the publishers of nodes are not all known, in brackets.

    Empty if no reason is known.
    """
    reasons = [
        f"{node.key}: {node.interface.may_publish_more}"
        for node in nodes
        if node.interface.may_publish_more
    ]
    return f" ({'; '.join(reasons[:_MAX_REASONS])})" if reasons else ""


COMPLETE_SOURCES = frozenset({"table", "file", "source"})
"""Sources that describe a node completely: its own code, or a recording of it."""


def as_version_warning(interface: Interface, finding: Finding) -> Finding:
    """Return the finding as a warning that names the package version it applies to."""
    version = f"as in {interface.described_package}"
    return replace(
        finding,
        help=f"{finding.help} ({version})" if finding.help else version,
        severity="warning",
        machine_dependent=True,
    )


def with_record(
    context: Context, finding: Finding, *rests_on: tuple[NodeWiring, InterfaceSource]
) -> Finding:
    """Return the finding with the recorded interfaces that it rests on.

    It is a warning if one of them was recorded with another version of the package.

    Args:
        context: the context of the spec.
        finding: what a rule found.
        rests_on: the nodes whose interfaces it follows from, each with the source of the part.
    """
    nodes = {node.key: node for node, source in rests_on if source == "file"}
    if not nodes:
        return finding
    names = ", ".join(node.interface.described_package for node in nodes.values())
    recorded = f"recorded in {names}"
    finding = replace(finding, help=f"{finding.help} ({recorded})" if finding.help else recorded)
    if any(context.record_versions(node) is not None for node in nodes.values()):
        finding = replace(finding, severity="warning", machine_dependent=True)
    return finding


def with_endpoint_records(
    context: Context, phase: PhaseWiring, finding: Finding, *endpoints: WiredEndpoint
) -> Finding:
    """Return a finding on endpoints with the recorded interfaces that it rests on."""
    rests_on = [
        (
            node,
            node.interface.publishes_from
            if endpoint.is_publisher
            else node.interface.subscribes_from,
        )
        for endpoint in endpoints
        if (node := phase.node(endpoint.owner)) is not None
    ]
    return with_record(context, finding, *rests_on)


def to_diagnostic(
    finding: Finding, code: str, severity: Severity, loaded: LoadedSpec
) -> Diagnostic:
    """Return the diagnostic of a finding; code and severity of the rule are the defaults."""
    if finding.part is not None:
        span = loaded.span_inside(finding.path, *finding.part)
    else:
        span = loaded.span(finding.path, key=finding.key)
    related = [
        Related(pointer.message, loaded.span(pointer.path, key=pointer.key))
        for pointer in finding.related
    ]
    # Where the variable is set from which the value comes.
    node = lookup(loaded.tree, finding.path)
    if isinstance(node, ScalarNode) and node.origin is not None and not finding.key:
        related.append(node.origin)
    return Diagnostic(
        code=finding.code or code,
        severity=Severity(finding.severity or severity),
        message=finding.message,
        span=span,
        path=finding.path,
        help=finding.help,
        related=tuple(related),
        edit=_edit(finding, span, loaded),
        certainty=Certainty.ENVIRONMENT if finding.machine_dependent else Certainty.CERTAIN,
    )


def _edit(finding: Finding, span: Span, loaded: LoadedSpec) -> Edit | None:
    """Return the replacement, if the text at `span` is exactly the text to replace."""
    if finding.replacement is None or span.line != span.end_line:
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
    """Return the diagnostics of differences between a spec and the real graph, sorted by place.

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


def failure_to_diagnostics(
    message: str, code: str, hint: str, blamed: str, loaded: LoadedSpec
) -> tuple[Diagnostic, ...]:
    """Return the diagnostic of a failed run, at the node or container that it blames, if any.

    Args:
        message: the message of the failure, without the output of a process.
        code: likewise.
        hint: what to do about it.
        blamed: a process of the plan, or the full name of a node.
        loaded: the document of the plan.
    """
    if loaded.spec is None:
        return ()
    context = Context(loaded, loaded.spec, offline=True)
    paths = [node.path for _, node in context.nodes if blamed in {node.name, node.key}]
    paths += [("containers", name) for name in loaded.spec.containers if name == blamed]
    return tuple(
        to_diagnostic(
            Finding(message=message, path=path, key=True, help=hint), code, Severity.ERROR, loaded
        )
        for path in paths[:1]
    )


def _path(difference: Difference, context: Context) -> tuple[Path, bool]:
    """Return the path of a difference, and whether it is about the key there."""
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
    """Return the place of the spec from which a node, the player or a monitor has this topic.

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
