"""Findings of the compiler as diagnostics of the protocol, and what can be done about them.

Quick fixes are the safe edits of findings, waivers, and commands that record what is unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from lsprotocol import types

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.diagnostics.code_pages import find_page, page_file
from r2bspec.diagnostics.edits import applicable_together
from r2bspec.diagnostics.waivers import NOT_WAIVABLE
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.commands import RECORD_INTERFACES, SpecCommand
from r2bspec.language_server.positions import TextPositions
from r2bspec.wiring.wiring import NodeWiring

_SEVERITIES: Final = {
    Severity.ERROR: types.DiagnosticSeverity.Error,
    Severity.WARNING: types.DiagnosticSeverity.Warning,
    Severity.INFO: types.DiagnosticSeverity.Information,
}

PositionsOf = Callable[[str], TextPositions]
"""The positions in the text of a file."""


def diagnostics_by_file(
    analysis: Analysis, positions_of: PositionsOf
) -> Mapping[str, list[types.Diagnostic]]:
    """The diagnostics of every file of an analysis; a file without findings has an empty list."""
    found: dict[str, list[types.Diagnostic]] = {
        name: [] for name in analysis.sources if _is_file(name)
    }
    found.setdefault(str(analysis.path), [])
    for each in analysis.diagnostics:
        # A finding in an option has no place in a file.
        file = each.span.file if _is_file(each.span.file) else str(analysis.path)
        found.setdefault(file, []).append(to_diagnostic(each, file, positions_of))
    return found


def to_diagnostic(each: Diagnostic, file: str, positions_of: PositionsOf) -> types.Diagnostic:
    """One finding."""
    span = each.span if each.span.file == file else Span.of_file(file)
    message = each.message[:1].upper() + each.message[1:]
    return types.Diagnostic(
        range=positions_of(file).range(_visible(span)),
        severity=_SEVERITIES[each.severity],
        code=each.code,
        code_description=types.CodeDescription(page_file(each.code).as_uri()),
        source="r2bspec",
        message=f"{message}\n{each.help}" if each.help else message,
        tags=[types.DiagnosticTag.Unnecessary] if _is_unused(each) else None,
        related_information=[
            types.DiagnosticRelatedInformation(
                types.Location(
                    uri(place.span.file), positions_of(place.span.file).range(place.span)
                ),
                place.message,
            )
            for place in each.related
            if _is_file(place.span.file)
        ]
        or None,
    )


def uri(file: str) -> str:
    """The URI of a file."""
    return Path(file).absolute().as_uri()


def _is_file(name: str) -> bool:
    """Whether a span is in a file, and not in an option or the environment."""
    return name.startswith("/")


def _visible(span: Span) -> Span:
    """A span with at least one character, so that editors can underline it."""
    if (span.line, span.column) == (span.end_line, span.end_column):
        return Span(span.file, span.line, span.column, span.line, span.column + 1)
    return span


def _is_unused(each: Diagnostic) -> bool:
    page = find_page(each.code)
    return page is not None and "unused" in page.slug.split("-")


_UNREADABLE = ("R2B0", "R2B1")
"""Errors of these codes leave no spec, and cannot be waived."""


def code_actions(
    analysis: Analysis, positions_of: PositionsOf, where: types.Range
) -> list[types.CodeAction]:
    """What can be done about the findings in a range, and about the node there."""
    positions = positions_of(str(analysis.path))
    start, end = positions.offset(where.start), positions.offset(where.end)
    here = [
        each
        for each in analysis.diagnostics
        if each.span.file == str(analysis.path) and _overlaps(positions, each, start, end)
    ]
    return [
        *_fixes(here, positions_of),
        *_waivers(analysis, here, positions_of),
        *_about_nodes(analysis, positions, start),
        *_fix_all(analysis, positions_of),
    ]


def _overlaps(positions: TextPositions, each: Diagnostic, start: int, end: int) -> bool:
    first, last = positions.offsets(each.span)
    return first <= end and start <= last


def _fixes(here: Sequence[Diagnostic], positions_of: PositionsOf) -> Iterator[types.CodeAction]:
    for each in here:
        if each.edit is None:
            continue
        file = each.edit.span.file
        text = each.edit.text
        edit = types.TextEdit(positions_of(file).range(each.edit.span), text)
        yield types.CodeAction(
            title=f"Replace with '{text}'" if text.strip() else "Remove it",
            kind=types.CodeActionKind.QuickFix,
            diagnostics=[to_diagnostic(each, each.span.file, positions_of)],
            is_preferred=True,
            edit=types.WorkspaceEdit(changes={uri(file): [edit]}),
        )


def _fix_all(analysis: Analysis, positions_of: PositionsOf) -> Iterator[types.CodeAction]:
    positions = positions_of(str(analysis.path))
    edits = [each.edit for each in analysis.diagnostics if each.edit is not None]
    own = (each for each in edits if each.span.file == str(analysis.path))
    changes = [
        types.TextEdit(positions.range(each.span), each.text)
        for each in applicable_together(positions.text, own)
    ]
    if changes:
        yield types.CodeAction(
            title="Apply all safe fixes of this file",
            kind=types.CodeActionKind.SourceFixAll,
            edit=types.WorkspaceEdit(changes={uri(str(analysis.path)): changes}),
        )


def _waivers(
    analysis: Analysis, here: Sequence[Diagnostic], positions_of: PositionsOf
) -> Iterator[types.CodeAction]:
    positions = positions_of(str(analysis.path))
    for each in here:
        unreadable = each.severity is Severity.ERROR and each.code.startswith(_UNREADABLE)
        if unreadable or each.code == NOT_WAIVABLE:
            continue
        start, _ = positions.line_at(positions.offsets(each.span)[0])
        page = find_page(each.code)
        name = page.slug if page is not None else each.code
        line = positions.text[start:]
        indent = line[: len(line) - len(line.lstrip(" "))]
        comment = f"{indent}# r2bspec: ignore[{name}] TODO: why this is intended\n"
        edit = types.TextEdit(positions.range_of_offsets(start, start), comment)
        yield types.CodeAction(
            title=f"Waive {each.code} here, with a reason",
            kind=types.CodeActionKind.QuickFix,
            diagnostics=[to_diagnostic(each, each.span.file, positions_of)],
            edit=types.WorkspaceEdit(changes={uri(str(analysis.path)): [edit]}),
        )


def _about_nodes(
    analysis: Analysis, positions: TextPositions, start: int
) -> Iterator[types.CodeAction]:
    context = analysis.context
    if context is None:
        return
    for _, node in context.nodes:
        span = analysis.loaded.span(node.path, key=True)
        if span.file != str(analysis.path):
            continue
        first, _ = positions.offsets(span)
        if positions.line_at(first)[0] != positions.line_at(start)[0]:
            continue
        if node.interface.publishes is None or node.interface.subscribes is None:
            command = SpecCommand(str(analysis.path), node=node.key)
            yield types.CodeAction(
                title=f"Record the interface of '{node.key}' (starts the node once)",
                kind=types.CodeActionKind.RefactorRewrite,
                command=command.as_command("Record the interface", RECORD_INTERFACES),
            )
        yield from _declarations(analysis, positions, node)


def _declarations(
    analysis: Analysis, positions: TextPositions, node: NodeWiring
) -> Iterator[types.CodeAction]:
    """Write down what is known of a node, or a form for what is not."""
    if node.node.publishes or node.interface.publishes_from == "spec":
        return
    value = analysis.loaded.span(node.path)
    line_start, _ = positions.line_at(positions.offsets(value)[0])
    own_key = analysis.loaded.span(node.path, key=True)
    if value.line == own_key.line:
        # A map in braces on the line of its key: the edit would change its style.
        return
    indent = " " * (value.column - 1)
    known = node.interface.publishes or {"TOPIC": "sensor_msgs/msg/Image"}
    lines = [f"{indent}publishes:", *(f"{indent}  {name}: {kind}" for name, kind in known.items())]
    edit = types.TextEdit(
        positions.range_of_offsets(line_start, line_start), "\n".join(lines) + "\n"
    )
    yield types.CodeAction(
        title=f"Declare what '{node.key}' publishes",
        kind=types.CodeActionKind.RefactorRewrite,
        edit=types.WorkspaceEdit(changes={uri(str(analysis.path)): [edit]}),
    )
