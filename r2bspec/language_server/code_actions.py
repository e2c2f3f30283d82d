"""Quick fixes: the safe edits of findings, waivers, and commands that record what is unknown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lsprotocol import types

from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.diagnostics.code_pages import find_page
from r2bspec.diagnostics.edits import applicable_together
from r2bspec.diagnostics.waivers import NOT_WAIVABLE
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.editor_commands import RECORD_INTERFACES, SpecCommand
from r2bspec.language_server.publish_diagnostics import PositionsOf, to_diagnostic, uri
from r2bspec.language_server.text_positions import TextPositions
from r2bspec.wiring.wiring import NodeWiring

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
