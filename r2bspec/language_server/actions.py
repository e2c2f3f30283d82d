"""What an editor offers to do with a spec: about its findings, and with commands.

Findings of the compiler are diagnostics of the protocol; quick fixes are their safe edits, waivers,
and commands that record what is unknown. Each command that the server runs for an editor is the
command line, in a process. An editor that has a terminal may register the same names and run them
itself. Lenses offer the commands above a spec, with its latest result; the test explorer of an
editor asks for the cases.
"""

from __future__ import annotations

import asyncio
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from lsprotocol import types

from r2bspec.api import folder_name
from r2bspec.diagnostics import Diagnostic, Severity, Span, did_you_mean
from r2bspec.diagnostics.code_pages import find_page, page_file
from r2bspec.diagnostics.diagnostic import Edit
from r2bspec.diagnostics.edits import applicable_together
from r2bspec.diagnostics.waivers import NOT_WAIVABLE
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.language.load_spec import load_cases
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.positions import TextPositions
from r2bspec.language_server.protocol import Range
from r2bspec.plan.wiring.wiring import NodeWiring
from r2bspec.safe_io.safe_file import unsaved_files

RUN: Final = "r2bspec.run"
SMOKE: Final = "r2bspec.smoke"
PLAN: Final = "r2bspec.plan"
DRAW_GRAPH: Final = "r2bspec.drawGraph"
RECORD_INTERFACES: Final = "r2bspec.recordInterfaces"
SHOW_RESULT: Final = "r2bspec.showResult"
"""Its argument is a run folder, and not a spec."""
_VERBS: Final = {
    RUN: ["run"],
    SMOKE: ["run", "--smoke"],
    PLAN: ["plan"],
    DRAW_GRAPH: ["plan", "--graph", "mermaid"],
    RECORD_INTERFACES: ["interfaces"],
}
COMMANDS: Final = tuple(_VERBS)
_R2BSPEC: Final = (sys.executable, "-P", "-m", "r2bspec")


@dataclass(frozen=True, slots=True)
class SpecCommand:
    """What a command is about: the argument that editors send back.

    Attributes:
        file: of the spec.
        case: of its matrix; empty without one.
        node: only this one; empty for all.
    """

    file: str
    case: str = ""
    node: str = ""

    def as_command(self, title: str, name: str) -> types.Command:
        """The command for an editor."""
        return types.Command(title, name, arguments=[asdict(self)])

    def argv(self, name: str) -> list[str]:
        """The words of the command line.

        Raises:
            UsageError: the file has no absolute path.
        """
        if not Path(self.file).is_absolute():
            raise UsageError("the command needs the absolute path of a spec as 'file'")
        node = ["--node", self.node] if self.node and name == RECORD_INTERFACES else []
        case = ["--case", self.case] if self.case else []
        return [*_R2BSPEC, *_VERBS[name], self.file, *node, *case]


def report_argv(folder: str) -> list[str]:
    """The words of the command line that prints the report of a run.

    Raises:
        UsageError: the folder is none of a run.
    """
    # Not `is_file` of the path, which raises for a name that is too long.
    if not Path(folder).is_absolute() or not os.path.isfile(f"{folder}/result.json"):  # noqa: PTH113
        raise UsageError("the command needs the absolute path of a run folder")
    return [*_R2BSPEC, "report", folder, "--report", "markdown=-"]


async def run_command(
    argv: list[str], folder: Path, on_line: Callable[[str], None]
) -> tuple[int, str]:
    """Run a command line; a cancelled one is ended in order, as with Ctrl-C.

    Args:
        argv: its words.
        folder: in which it runs.
        on_line: is called with every line of its progress.

    Returns:
        The exit status, and what it printed on standard output.

    Raises:
        UsageError: it cannot be started, as in a folder that has gone.
    """
    try:
        process = await asyncio.create_subprocess_exec(
            *argv,
            cwd=folder,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            limit=1 << 20,
        )
    except (OSError, ValueError) as error:
        raise UsageError(f"no command can be started in {folder}: {error}") from error
    try:
        assert process.stdout is not None  # noqa: S101 - it is a pipe
        assert process.stderr is not None  # noqa: S101 - it is one, too
        told = _tell(process.stderr, on_line)
        _, output = await asyncio.gather(told, process.stdout.read())
        return await process.wait(), output.decode("utf-8", "replace")
    except asyncio.CancelledError:
        process.send_signal(2)
        await process.wait()
        raise


async def _tell(stream: asyncio.StreamReader, on_line: Callable[[str], None]) -> None:
    while line := await stream.readline():
        on_line(line.decode("utf-8", "replace").rstrip())


_MAX_TRIED: Final = 5
"""Newer folders without a result that are passed over: of runs that were interrupted."""


def latest_result(name: str, folder: Path) -> types.Command | None:
    """The command that shows the newest result of a benchmark; its title is that in one line.

    Args:
        name: of the benchmark, with its case.
        folder: in which runs were started, with the folder ``runs``.
    """
    from r2bspec.compare.report_input import read_result
    from r2bspec.judge.measure.units import show

    beginning = f"{folder_name(name)}-"
    try:
        runs = [run for run in (folder / "runs").iterdir() if run.name.startswith(beginning)]
        runs.sort(key=lambda run: run.stat().st_mtime, reverse=True)
    except (OSError, ValueError):
        return None
    for run in runs[:_MAX_TRIED]:
        try:
            result = read_result(run / "result.json")
        except R2bspecError:
            continue
        if result.name == name:
            # That of the first monitor at the first rate.
            p99s = (
                monitor.latency.p99
                for rate in result.metrics.rates
                for monitor in rate.pooled.monitors.values()
            )
            latency = next((p99 for p99 in p99s if p99 is not None), None)
            measured = f"p99 {show(latency, 's')}, " if latency is not None else ""
            title = f"last result: {measured}{result.verdict.outcome.upper()}"
            return types.Command(title, SHOW_RESULT, arguments=[str(run)])
    return None


_MAX_CASES: Final = 8
"""Cases with lenses of their own; a long line of them could not be read."""


def code_lenses(
    analysis: Analysis, positions: TextPositions, folder: Path
) -> Iterator[types.CodeLens]:
    """The lenses of a document: of each case one line.

    Args:
        analysis: of the document.
        positions: of its text.
        folder: in which runs are started.
    """
    if analysis.context is None:
        return
    # The name may be in an extended file: the lenses are at the beginning of this one then.
    place = analysis.loaded.span(("name",), key=True)
    is_here = place.file == str(analysis.path)
    where = positions.range(place) if is_here else positions.range_of_offsets(0, 0)
    for loaded in analysis.cases[:_MAX_CASES]:
        about = SpecCommand(str(analysis.path), loaded.case)
        suffix = f" {loaded.case}" if loaded.case else ""
        for title, name in (("run", RUN), ("smoke", SMOKE), ("plan", PLAN), ("graph", DRAW_GRAPH)):
            if not suffix or name in {RUN, SMOKE}:
                yield types.CodeLens(where, about.as_command(f"{title}{suffix}", name))
        if (latest := latest_result(loaded.id, folder)) is not None:
            yield types.CodeLens(where, latest)


REQUEST: Final = "r2bspec/cases"
"""The request of the protocol: its parameters are ``{"uri": ...}`` of a spec."""


@dataclass(frozen=True, slots=True)
class SpecCase:
    """One case, as it is sent.

    Attributes:
        name: of the benchmark with its case, as results have it.
        case: of the matrix, as ``--case`` takes it; empty without one.
        line: of the name in the spec, from 0.
    """

    name: str
    case: str
    line: int


def spec_cases(path: Path, text: str, unsaved: Mapping[Path, str]) -> list[SpecCase]:
    """The cases of a text; of one with errors those that can be told.

    Args:
        path: of the file, absolute.
        text: of the document, saved or not.
        unsaved: the texts of open files, which take the place of what is on disk.
    """
    with unsaved_files(unsaved):
        cases = load_cases(text, file=str(path))
    cases_found = []
    for loaded in cases:
        place = loaded.span(("name",), key=True)
        # The name of the benchmark may be in an extended file.
        line = place.line - 1 if place.file == str(path) else 0
        cases_found.append(SpecCase(loaded.id, loaded.case, max(line, 0)))
    return cases_found


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
    diagnostics: dict[str, list[types.Diagnostic]] = {
        name: [] for name in analysis.sources if _is_file(name)
    }
    diagnostics.setdefault(str(analysis.path), [])
    for diagnostic in analysis.diagnostics:
        # A finding in an option has no place in a file.
        file = diagnostic.span.file if _is_file(diagnostic.span.file) else str(analysis.path)
        diagnostics.setdefault(file, []).append(to_diagnostic(diagnostic, file, positions_of))
    return diagnostics


def to_diagnostic(each: Diagnostic, file: str, positions_of: PositionsOf) -> types.Diagnostic:
    """One finding."""
    span = each.span if each.span.file == file else Span.of_file(file)
    return types.Diagnostic(
        range=positions_of(file).range(_visible(span)),
        severity=_SEVERITIES[each.severity],
        code=each.code,
        code_description=types.CodeDescription(page_file(each.code).as_uri()),
        source="r2bspec",
        # Not with a capital: a message may begin with a name of the spec.
        message=f"{each.message}\n{each.help}" if each.help else each.message,
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


def _edits(file: str, *edits: types.TextEdit) -> types.WorkspaceEdit:
    return types.WorkspaceEdit(changes={uri(file): [*edits]})


_UNREADABLE = ("R2B0", "R2B1")
"""Errors of these codes leave no spec, and cannot be waived."""


def code_actions(
    analysis: Analysis, positions_of: PositionsOf, where: Range
) -> list[types.CodeAction]:
    """What can be done about the findings in a range, and about the node there."""
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
    """The name that a finding proposes in place of what it is at, if that is the wrong name.

    It is a guess, which a person may choose and nothing else applies.
    """
    found = _MEANT.match(each.help)
    if found is None or not _is_file(each.span.file) or each.span.line != each.span.end_line:
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
        edit=_edits(str(analysis.path), edit),
    )
