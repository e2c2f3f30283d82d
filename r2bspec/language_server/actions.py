"""The actions that an editor offers for a spec: fixes of findings, and commands.

Quick fixes are the safe edits of findings, waivers, and commands that record what is unknown.
Lenses offer commands above a spec. A command is a command line, run in a process; an editor with a
terminal may register the same names and run them itself.
"""

from __future__ import annotations

import asyncio
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from lsprotocol import types

from r2bspec.diagnostics import Diagnostic, Severity, did_you_mean
from r2bspec.diagnostics.code_pages import find_page
from r2bspec.diagnostics.diagnostic import Edit
from r2bspec.diagnostics.edits import applicable_together
from r2bspec.diagnostics.waivers import NOT_WAIVABLE
from r2bspec.language.load_spec import load_cases
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.findings import PositionsOf, is_file, to_diagnostic, uri
from r2bspec.language_server.positions import TextPositions
from r2bspec.plan.wiring.wiring import NodeWiring
from r2bspec.safe_io.safe_file import unsaved_files

RUN: Final = "r2bspec.run"
SMOKE: Final = "r2bspec.smoke"
PLAN: Final = "r2bspec.plan"
DRAW_GRAPH: Final = "r2bspec.drawGraph"
RECORD_INTERFACES: Final = "r2bspec.recordInterfaces"
_VERBS: Final = {
    RUN: ["run"],
    SMOKE: ["run", "--smoke"],
    PLAN: ["plan"],
    DRAW_GRAPH: ["plan", "--graph", "mermaid"],
    RECORD_INTERFACES: ["interfaces"],
}
COMMANDS: Final = tuple(_VERBS)


def _command(title: str, name: str, path: Path, **about: str) -> types.Command:
    """Return a command about the spec of a file, and a case or a node of it."""
    return types.Command(title, name, arguments=[{"file": str(path), **about}])


async def run_command(name: str, about: Mapping[str, str], folder: Path) -> tuple[int, str]:
    """Run a command, and return its exit status and its output.

    Args:
        name: one of `COMMANDS`.
        about: the file of the spec, and the case or the node that is meant.
        folder: in which it runs.
    """
    options = [
        word
        for option in ("case", "node")
        if about.get(option)
        for word in (f"--{option}", about[option])
    ]
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-P", "-m", "r2bspec", *_VERBS[name], about["file"], *options),
        cwd=folder,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    output, _ = await process.communicate()
    return process.returncode or 0, output.decode("utf-8", "replace")


_MAX_CASES: Final = 8
"""Cases with lenses of their own; a long line of them could not be read."""


def code_lenses(analysis: Analysis, positions: TextPositions) -> Iterator[types.CodeLens]:
    """Yield the lenses of a document: a line for each case."""
    if analysis.context is None:
        return
    # The name may be in an extended file: the lenses are at the beginning of this one then.
    place = analysis.loaded.span(("name",), key=True)
    is_here = place.file == str(analysis.path)
    where = positions.range(place) if is_here else positions.range_of_offsets(0, 0)
    for loaded in analysis.cases[:_MAX_CASES]:
        about = {"case": loaded.case} if loaded.case else {}
        suffix = f" {loaded.case}" if loaded.case else ""
        for title, name in (("run", RUN), ("smoke", SMOKE), ("plan", PLAN), ("graph", DRAW_GRAPH)):
            if not suffix or name in {RUN, SMOKE}:
                command = _command(f"{title}{suffix}", name, analysis.path, **about)
                yield types.CodeLens(where, command)


REQUEST: Final = "r2bspec/cases"
"""The request of the protocol: its parameters are ``{"uri": ...}`` of a spec."""


def spec_cases(path: Path, text: str, unsaved: Mapping[Path, str]) -> list[dict[str, Any]]:
    """Return the cases of a text; of a text with errors, as far as they can be determined.

    Each has the name of the benchmark with its case, the case as ``--case`` takes it, and the line
    of the name in the spec, from 0.

    Args:
        path: of the file, absolute.
        text: of the document, saved or not.
        unsaved: the texts of open files, which take the place of what is on disk.
    """
    with unsaved_files(unsaved):
        cases = load_cases(text, file=str(path))
    found = []
    for loaded in cases:
        place = loaded.span(("name",), key=True)
        # The name of the benchmark may be in an extended file.
        line = place.line - 1 if place.file == str(path) else 0
        found.append({"name": loaded.id, "case": loaded.case, "line": max(line, 0)})
    return found


def _edits(file: str, *edits: types.TextEdit) -> types.WorkspaceEdit:
    return types.WorkspaceEdit(changes={uri(file): [*edits]})


_UNREADABLE = ("R2B0", "R2B1")
"""Errors of these codes leave no spec, and cannot be waived."""


def code_actions(
    analysis: Analysis, positions_of: PositionsOf, where: types.Range
) -> list[types.CodeAction]:
    """Return the actions for the findings in a range, and for the node there."""
    positions = positions_of(str(analysis.path))
    start, end = positions.offset(where.start), positions.offset(where.end)
    here = [
        diagnostic
        for diagnostic in analysis.diagnostics
        if diagnostic.span.file == str(analysis.path)
        and _overlaps(positions, diagnostic, start, end)
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
    for finding in here:
        edit = finding.edit or _meant(finding, positions_of)
        if edit is None:
            continue
        span, text = edit.span, edit.text
        yield types.CodeAction(
            title=f"Replace with '{text}'" if text.strip() else "Remove it",
            kind=types.CodeActionKind.QuickFix,
            diagnostics=[to_diagnostic(finding, finding.span.file, positions_of)],
            is_preferred=True,
            edit=_edits(span.file, types.TextEdit(positions_of(span.file).range(span), text)),
        )


_MEANT: Final = re.compile(r"^did you mean '([^']+)'\?")


def _meant(each: Diagnostic, positions_of: PositionsOf) -> Edit | None:
    """Return the name that a finding proposes in place of what it is at, if that is the wrong name.

    It is a guess, which a person may choose and nothing else applies.
    """
    found = _MEANT.match(each.help)
    if found is None or not is_file(each.span.file) or each.span.line != each.span.end_line:
        return None
    positions = positions_of(each.span.file)
    start, end = positions.offsets(each.span)
    written = positions.text[start:end]
    quote = written[:1] if written[:1] in {"'", '"'} else ""
    if did_you_mean(written.strip("'\""), [found[1]]) != found[1]:
        return None
    return Edit(each.span, f"{quote}{found[1]}{quote}")


def _fix_all(analysis: Analysis, positions_of: PositionsOf) -> Iterator[types.CodeAction]:
    positions = positions_of(str(analysis.path))
    edits = [diagnostic.edit for diagnostic in analysis.diagnostics if diagnostic.edit is not None]
    own = (edit for edit in edits if edit.span.file == str(analysis.path))
    changes = [
        types.TextEdit(positions.range(edit.span), edit.text)
        for edit in applicable_together(positions.text, own)
    ]
    if changes:
        yield types.CodeAction(
            title="Apply all safe fixes of this file",
            kind=types.CodeActionKind.SourceFixAll,
            edit=_edits(str(analysis.path), *changes),
        )


def _waivers(
    analysis: Analysis, here: Sequence[Diagnostic], positions_of: PositionsOf
) -> Iterator[types.CodeAction]:
    positions = positions_of(str(analysis.path))
    for finding in here:
        unreadable = finding.severity is Severity.ERROR and finding.code.startswith(_UNREADABLE)
        if unreadable or finding.code == NOT_WAIVABLE:
            continue
        start, _ = positions.line_at(positions.offsets(finding.span)[0])
        page = find_page(finding.code)
        name = page.slug if page is not None else finding.code
        line = positions.text[start:]
        indent = line[: len(line) - len(line.lstrip(" "))]
        comment = f"{indent}# r2bspec: ignore[{name}] TODO: why this is intended\n"
        edit = types.TextEdit(positions.range_of_offsets(start, start), comment)
        yield types.CodeAction(
            title=f"Waive {finding.code} here, with a reason",
            kind=types.CodeActionKind.QuickFix,
            diagnostics=[to_diagnostic(finding, finding.span.file, positions_of)],
            edit=_edits(str(analysis.path), edit),
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
        if node.interface.topics is None:
            yield types.CodeAction(
                title=f"Record the interface of '{node.key}' (starts the node once)",
                kind=types.CodeActionKind.RefactorRewrite,
                command=_command(
                    "Record the interface", RECORD_INTERFACES, analysis.path, node=node.key
                ),
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
        edit=_edits(str(analysis.path), edit),
    )
