"""What can be written as a value, or as a key that is a name: from the spec, its bag, this machine.

Each source is a function of the analysis and the path; a table names the paths that it serves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from lsprotocol import types

from r2bspec.diagnostics import Path
from r2bspec.language.declaration import rule_at
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.language_server import proposed_files as files
from r2bspec.language_server import proposed_names as names
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.cursor_context import CursorContext
from r2bspec.language_server.proposals import Proposal, ProposalSource
from r2bspec.language_server.proposed_requirements import quantities, requirements
from r2bspec.language_server.proposed_types import message_types


def proposed_values(analysis: Analysis | None, context: CursorContext) -> Iterator[Proposal]:
    """The values that can be written at the path of a context."""
    if analysis is not None:
        for pattern, source in _VALUES:
            if _matches(context.path, pattern):
                yield from source(analysis, context)
    yield from _schema_values(context)


def names_as_keys(analysis: Analysis | None, context: CursorContext) -> Iterator[Proposal]:
    """The names that can be the keys of the map at the path of a context."""
    if analysis is not None:
        for pattern, source in _KEYS:
            if _matches(context.path, pattern):
                for each in source(analysis, context):
                    yield each if context.has_colon else _as_key(each)


def _as_key(each: Proposal) -> Proposal:
    return Proposal(
        each.label,
        each.detail,
        each.documentation,
        f"{each.insert or each.label}: ",
        each.kind,
        each.is_snippet,
        each.order,
    )


def _matches(path: Path, pattern: Sequence[str]) -> bool:
    """Whether a path fits a pattern: ``*`` is any part, ``**`` at first any beginning."""
    if pattern[0] == "**":
        tail = pattern[1:]
        return len(path) >= len(tail) and _matches(path[len(path) - len(tail) :], tail)
    return len(path) == len(pattern) and all(
        wanted in {"*", part} for part, wanted in zip(path, pattern, strict=True)
    )


def _schema_values(context: CursorContext) -> Iterator[Proposal]:
    rule = rule_at(context.path)
    if rule is None:
        return
    yield from quantities(rule, context.before)
    if rule.kinds == ("boolean",):
        yield from (Proposal(each, order=10) for each in ("true", "false"))
    default = rule.shown_default
    if rule.const is not None:
        yield Proposal(str(rule.const), order=10)
    for word in rule.words:
        yield Proposal(
            str(word),
            detail="default" if word == default else "",
            kind=types.CompletionItemKind.EnumMember,
            order=10,
        )
    if isinstance(default, str | int | float) and default != "" and not rule.is_choice:
        yield Proposal(
            str(default).lower() if isinstance(default, bool) else str(default), "default", order=20
        )
    for example in rule.about.examples:
        if isinstance(example, str) and rule.quantity is not Requirement:
            yield Proposal(example, "example", order=800)


_VALUES: Final[tuple[tuple[tuple[str, ...], ProposalSource], ...]] = (
    (("slos", "*", "require"), requirements),
    (("slos", "*", "require", "*"), requirements),
    (("benchmark", "search", "holds"), requirements),
    (("benchmark", "search", "holds", "*"), requirements),
    (("slos", "*", "at"), names.rates),
    (("slos", "*", "when", "*"), names.axis_values),
    (("matrix", "exclude", "*", "*"), names.axis_values),
    (("data_loader", "bag"), files.recordings),
    (("data_loader", "bag", "dataset"), files.recordings),
    (("data_loader", "bag", "path"), files.recordings),
    (("data_loader", "topics", "*"), names.graph_topics),
    (("playback", "inputs", "*", "from"), names.graph_topics),
    (("playback", "inputs", "*", "format"), message_types),
    (("monitors", "*", "topic"), names.graph_topics),
    (("monitors", "*", "format"), message_types),
    (("monitors", "*", "answers", "*"), names.inputs),
    (("**", "remappings", "*"), names.graph_topics),
    (("**", "publishes", "*"), message_types),
    (("**", "subscribes", "*"), message_types),
    (("**", "container"), names.containers),
    (("**", "python"), files.python_classes),
    (("**", "package"), files.packages),
    (("**", "executable"), files.executables),
    (("**", "plugin"), files.plugins),
    (("extends",), files.yaml_files),
    (("extends", "*"), files.yaml_files),
    (("**", "launch", "path"), files.any_file),
    (("**", "launch", "file"), files.launch_files),
    (("**", "parameters"), files.yaml_files),
    (("**", "parameters", "*"), names.parameter_values),
    (("**", "parameters", "*", "*"), names.parameter_values),
)

_KEYS: Final[tuple[tuple[tuple[str, ...], ProposalSource], ...]] = (
    (("data_loader", "topics"), names.bag_topics),
    (("playback", "inputs"), names.input_topics),
    (("**", "remappings"), names.own_topics),
    (("graph", "nodes", "*", "parameters"), names.parameters),
    (("graph", "nodes", "*", "parameters", "*"), names.parameters),
    (("preprocessors", "*", "parameters"), names.parameters),
    (("preprocessors", "*", "parameters", "*"), names.parameters),
    (("slos", "*", "when"), names.case_variables),
    (("matrix", "exclude", "*"), names.axes),
    (("matrix", "cases", "*"), names.case_variables),
    (("matrix", "axes"), names.variables),
)
