"""Whether the gate of a head is weaker than that of its base: a gate cannot weaken itself.

Whoever changes a graph can change its spec, too. So everything that a verdict depends on is
compared with the base: objectives, monitors, inputs, data, durations and the rest of
`r2bspec.compare.gate_keys`, and waivers. What is weaker is an error, unless the pipeline allows it
by name. What is stronger is stated. The graph under test is free to change.

Nothing is executed, and no file is read: what is compared are compiled specs.

A waiver is the same if it waives the same code on the same key, so that it may move with its line
and give another reason. On a line without a key, as in a text that another file replaces, it is the
same if it gives the same reason.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from r2bspec.compare.gate_change import GateChange, spec_of
from r2bspec.compare.gate_keys import input_names, plan_changes
from r2bspec.diagnostics import Diagnostic, Severity, did_you_mean
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.diagnostics.diagnostic import Path, Span
from r2bspec.diagnostics.quote import first_words, quote
from r2bspec.diagnostics.waivers import Waiver, effective_waivers
from r2bspec.errors import ExitStatus, R2bspecError, UsageError
from r2bspec.language.located_tree import ListNode, MapNode, TreeNode
from r2bspec.language.spec import Pacing
from r2bspec.plan.prepared_benchmark import PreparedBenchmark

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec
    from r2bspec.language.spec import Objective
    from r2bspec.plan.plan import Plan


WEAKER_GATE: Final = "R2B692"
MISSING_OBJECTIVES: Final = "R2B693"

KEY_NAMES: Final = (
    *("data", "playback", "preprocessors", "rates", "duration", "iterations", "max_iterations"),
    *("starts", *Pacing.__struct_fields__, "search", "confidence"),
    *("gate.inconclusive", "gate.confirm", "gate.time_budget", "gate.interference", "gate.base"),
    *("transport", "harness", "requires", "base"),
)
"""Names that every comparison knows. ``base`` is a base that cannot be used at all."""

_WAIVER_OR_SPEC: Final = re.compile(r"waiver R2B\d{3}|(?:spec|case) .+")
_MAX_LISTED: Final = 40


@dataclass(frozen=True)
class GateComparison:
    """The gate of a head beside that of its base; `stronger` are sentences."""

    weaker: tuple[GateChange, ...] = ()
    stronger: tuple[str, ...] = ()

    @property
    def sentences(self) -> tuple[str, ...]:
        """What reports say of it, where all that is weaker was allowed."""
        allowed = (f"allowed: {weakening.name} ({weakening.text})" for weakening in self.weaker)
        return (*allowed, *(f"stronger: {sentence}" for sentence in self.stronger))


class WeakerGateError(R2bspecError):
    """The gate of the head is weaker than that of the base.

    Attributes:
        diagnostics: each way in which it is, at its place.
        loaded: the head, with the texts that the diagnostics refer to; None for a plan.
    """

    code = WEAKER_GATE
    exit_code = ExitStatus.USAGE

    def __init__(
        self,
        weaker: Sequence[GateChange],
        diagnostics: Sequence[Diagnostic],
        loaded: LoadedSpec | None,
        base_name: str,
    ) -> None:
        names = dict.fromkeys(weakening.name for weakening in weaker)
        options = " ".join(f"--allow {shlex.quote(name)}" for name in names)
        # Without a document there is no place at which the changes are shown.
        changes = (
            names
            if loaded is not None
            else [f"{weakening.name} ({weakening.text})" for weakening in weaker]
        )
        super().__init__(
            f"the gate is weaker than in {base_name}: {', '.join(changes)}",
            hint=f"Undo the change, or let the pipeline allow it: {options}",
        )
        self.diagnostics = tuple(diagnostics)
        self.loaded = loaded


class MissingObjectivesError(R2bspecError):
    """No objective can fail the run.

    Attributes:
        diagnostic: the same as a finding.
    """

    code = MISSING_OBJECTIVES
    exit_code = ExitStatus.USAGE

    def __init__(self, diagnostic: Diagnostic) -> None:
        super().__init__(diagnostic.message, hint=f"{diagnostic.help.capitalize()}.")
        self.diagnostic = diagnostic


def compare_gates(base: PreparedBenchmark, head: PreparedBenchmark) -> GateComparison:
    """What of the gate is weaker in the head, and what is stronger.

    Args:
        base: to compare with, prepared.
        head: to be judged, prepared.
    """
    changes = list(dict.fromkeys(plan_changes(base, head)))
    if base.loaded is not None and head.loaded is not None:
        changes += waiver_changes(base.loaded, head.loaded)
    return GateComparison(
        tuple(change for change in changes if change.weaker),
        tuple(f"{change.name} ({change.text})" for change in changes if not change.weaker),
    )


def check_gate(
    base: PreparedBenchmark,
    head: PreparedBenchmark,
    allowed: Sequence[str] = (),
    *,
    base_name: str = "the base",
    known_names: Collection[str] = (),
) -> GateComparison:
    """Compare two gates, and refuse a weaker one that the pipeline does not allow.

    Args:
        base: to compare with.
        head: to be judged.
        allowed: the names that the pipeline allows.
        base_name: what the user called the base, for messages.
        known_names: further names that may be allowed, because another spec has them.

    Returns:
        The comparison; everything in it that is weaker is allowed.

    Raises:
        WeakerGateError: the gate is weaker.
        UsageError: a name is allowed that nothing has.
    """
    check_allowed(allowed, (*allowable_names(base, head), *known_names))
    comparison = compare_gates(base, head)
    refused = [weakening for weakening in comparison.weaker if weakening.name not in allowed]
    if refused:
        diagnostics = weakening_diagnostics(refused, head.loaded, base_name)
        raise WeakerGateError(refused, diagnostics, head.loaded, base_name)
    return comparison


def allowable_names(base: PreparedBenchmark, head: PreparedBenchmark) -> tuple[str, ...]:
    """The names that ``--allow`` may have for two specs, besides waivers and specs."""
    names = list(KEY_NAMES)
    for side in (base, head):
        spec = spec_of(side)
        objectives = spec.slos if spec is not None else side.plan.objectives
        names += [f"objective {name}" for name in objectives]
        names += [f"monitor {monitor.name}" for monitor in side.plan.monitors]
        names += [f"input {name}" for name in input_names(side).values()]
        names += [
            f"memory_limit {process.name}"
            for process in side.plan.processes
            if process.memory_limit_bytes
        ]
    return tuple(dict.fromkeys(names))


def check_allowed(allowed: Iterable[str], known: Collection[str]) -> None:
    """Refuse names that nothing has: an allowance that is misspelt would have no effect.

    Args:
        allowed: the names that the pipeline allows.
        known: from `allowable_names`, for all specs.

    Raises:
        UsageError: there is one.
    """
    for name in allowed:
        if name in known or _WAIVER_OR_SPEC.fullmatch(name):
            continue
        close = did_you_mean(name, known)
        listed = [*dict.fromkeys(known)]
        raise UsageError(
            f"--allow {quote(name)}: nothing in the gate has this name"
            + (f"; did you mean {quote(close)}?" if close else ""),
            hint=f"Names are {first_words(listed, _MAX_LISTED)}, 'waiver CODE', "
            "'spec PATH' and 'case NAME'.",
        )


def weakening_diagnostics(
    weaker: Iterable[GateChange], head: LoadedSpec | None, base_name: str
) -> tuple[Diagnostic, ...]:
    """Findings at the place of each value in the head, or of its nearest parent if it is gone.

    Args:
        weaker: what they are about.
        head: the document; None if there is none, as for a plan from a file.
        base_name: what the user called the base.
    """
    diagnostics = []
    for weakening in weaker:
        span = weakening.span
        if span is None:
            span = head.span(weakening.path) if head is not None else Span.of_file("<plan>")
        diagnostics.append(
            Diagnostic(
                WEAKER_GATE,
                Severity.ERROR,
                f"weaker gate than in {base_name}: {weakening.name}: {weakening.text}",
                span,
                path=weakening.path,
                help="undo the change; the pipeline can allow it: "
                f"--allow {shlex.quote(weakening.name)}",
            )
        )
    return tuple(sorted(diagnostics, key=lambda diagnostic: diagnostic.sort_key))


def require_objectives(plan: Plan, file: str = "") -> None:
    """Refuse a plan that nothing can fail.

    Args:
        plan: to be run.
        file: of the spec, for the message; the name of the plan if empty.

    Raises:
        MissingObjectivesError: no active objective of level ``error`` has a requirement.
    """
    if not can_fail(plan.objectives):
        raise MissingObjectivesError(missing_objectives(file or plan.name))


def can_fail(objectives: Mapping[str, Objective]) -> bool:
    """Whether one of the active objectives has the level ``error`` and a requirement."""
    return any(
        objective.level == "error" and objective.require for objective in objectives.values()
    )


def missing_objectives(file: str, cases: Sequence[str] = ()) -> Diagnostic:
    """The finding that a spec, or some cases of it, has no objective that can fail."""
    of_cases = f" in {', '.join(cases[:12])}" if cases else ""
    return Diagnostic(
        MISSING_OBJECTIVES,
        Severity.ERROR,
        f"no active objective of level error{of_cases}: nothing can fail",
        Span.of_file(file),
        help="add a requirement under 'slos', or restore the one that was deleted",
    )


_WaiverKey = tuple[str, Path | str]


def waiver_changes(base: LoadedSpec, head: LoadedSpec) -> Iterator[GateChange]:
    """New waivers, which make a gate weaker, and waivers that are gone."""
    before, after = _waivers(base), _waivers(head)
    for key, waiver in after.items():
        if key not in before:
            yield GateChange(f"waiver {waiver.code}", (), "", waiver.reason, span=waiver.span)
    for key, waiver in before.items():
        if key not in after:
            yield GateChange(f"waiver {waiver.code}", (), waiver.reason, "", weaker=False)


def _waivers(loaded: LoadedSpec) -> dict[_WaiverKey, Waiver]:
    slugs = {code: page.slug for code, page in all_pages().items()}
    waivers = list(effective_waivers(loaded.texts, slugs))
    paths = _paths_by_line(loaded.tree) if waivers and loaded.tree is not None else {}
    return {
        (waiver.code, paths.get((waiver.span.file, waiver.line), waiver.reason)): waiver
        for waiver in waivers
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
