"""The parts of a spec that a gate depends on: they differ only if the pipeline allows it.

Whoever changes a graph can change its spec, too. So two versions of a spec are compared, section by
section, without executing anything or reading a further file. `GATED` sections must be equal, and
the base's objectives of level ``error`` must be there with the same terms and limits, or tighter
ones. `FREE` sections are the graph, and texts for people. Any other difference is an error at its
line with both values, unless the pipeline allows it by name: the key, as it is written
(``benchmark.rates``), or ``objective NAME``, ``monitor NAME``, ``input NAME``, ``call NAME``,
``preprocessors``, ``memory_limit NAME``, ``waiver CODE``, ``spec PATH`` and ``case NAME[CASE]``.

New objectives, requirements and monitors need no allowance.

A waiver is the same if it waives the same code on the same key, so that it may move with its line.
On a line without a key, as in a text that another file replaces, it is the same if it gives the
same reason.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import msgspec

from r2bspec.diagnostics import Diagnostic, Severity, did_you_mean
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.diagnostics.diagnostic import Path, Span
from r2bspec.diagnostics.quote import clip, first_words, quote
from r2bspec.diagnostics.waivers import Waiver, effective_waivers
from r2bspec.errors import ExitStatus, R2bspecError, UsageError
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.declaration import encode_text
from r2bspec.language.load_spec import LoadedSpec
from r2bspec.language.located_tree import ListNode, MapNode, TreeNode
from r2bspec.language.spec import Objective, Spec
from r2bspec.plan.compile_plan import active_objectives

WEAKER_GATE: Final = "R2B692"
MISSING_OBJECTIVES: Final = "R2B693"

GATED: Final = (
    *("requires", "transport", "network", "harness", "data_loader", "preprocessors", "playback"),
    *("monitors", "benchmark"),
)
"""The sections that decide how a graph is loaded, measured and judged; objectives apart."""

FREE: Final = (
    *("r2bspec", "name", "title", "description", "labels", "variables", "tune"),
    *("environment", "namespace", "containers", "setup", "graph", "ready", "after_ready"),
)
"""The sections that are the graph, or words. What variables change is compared where it is."""

ALLOW_BASE: Final = "base"
"""The name under which a pipeline allows a base that cannot be played."""

ALLOW_INPUT: Final = "input"
"""The name under which it allows another recording, or other files of the preprocessors."""

_NAMED: Final[Mapping[Path, str]] = {
    ("monitors",): "monitor",
    ("playback", "inputs"): "input",
    ("playback", "calls"): "call",
    ("slos",): "objective",
}
"""The maps whose entries have names of their own, and what one of them is called."""

_OTHER_NAMES: Final = re.compile(r"waiver R2B\d{3}|(?:spec|case) .+")
_MAX_TEXT: Final = 100
_MAX_LISTED: Final = 40
_ABSENT: Final = object()


class GateChange(NamedTuple):
    """A difference that a verdict may depend on.

    Attributes:
        name: what ``--allow`` takes.
        path: the path of the value in the head's document; the value may be gone.
        before: the value of the base as text; empty if it has none.
        after: the value of the head as text; empty if it has none.
        span: the place in the head, if it is not at `path`.
        way_out: what to do besides allowing it.
    """

    name: str
    path: Path
    before: str
    after: str
    span: Span | None = None
    way_out: str = "undo the change"

    @classmethod
    def of_tip(cls, name: str, file: str, tip: str, after: str) -> GateChange:
        """Return the difference to a file that the base has changed since the head branched off.

        Args:
            name: what ``--allow`` takes.
            file: its path.
            tip: the base with these commits.
            after: what the head has; empty if it lacks the file.
        """
        before, span = f"{clip(file)} of {tip}", Span.of_file(file)
        return cls(name, (), before, after, span, way_out=f"merge {tip}, or rebase")

    @property
    def text(self) -> str:
        """Both values, the new value first."""
        if not self.after:
            return f"gone, was {self.before}" if self.before else "gone"
        return f"{self.after}, was {self.before}" if self.before else f"new, {self.after}"


class WeakerGateError(R2bspecError):
    """The gate of the head differs from that of the base.

    Attributes:
        diagnostics: each difference, at its place.
        loaded: the head, with the texts that the diagnostics refer to; None for a set of specs.
    """

    code = WEAKER_GATE
    exit_code = ExitStatus.USAGE

    def __init__(
        self, changes: Sequence[GateChange], loaded: LoadedSpec | None, base_name: str
    ) -> None:
        names = dict.fromkeys(change.name for change in changes)
        # Without a document there is no place at which the changes are shown.
        shown = names if loaded else [f"{change.name} ({change.text})" for change in changes]
        super().__init__(
            f"the gate differs from that of {base_name}: {', '.join(shown)}",
            hint=f"{changes[0].way_out.capitalize()}, or let the pipeline allow it: "
            + " ".join(f"--allow {shlex.quote(name)}" for name in names),
        )
        self.loaded = loaded
        self.diagnostics = tuple(
            sorted(
                (_diagnostic(change, loaded, base_name) for change in changes),
                key=lambda diagnostic: diagnostic.sort_key,
            )
        )


class MissingObjectivesError(R2bspecError):
    """No objective can fail the run.

    Attributes:
        diagnostic: the same as a finding.
    """

    code = MISSING_OBJECTIVES
    exit_code = ExitStatus.USAGE

    def __init__(self, file: str) -> None:
        self.diagnostic = Diagnostic(
            MISSING_OBJECTIVES,
            Severity.ERROR,
            "no active objective of level error: nothing can fail",
            Span.of_file(file),
            help="add a requirement under 'slos', or restore the one that was deleted",
        )
        super().__init__(self.diagnostic.message, hint=f"{self.diagnostic.help.capitalize()}.")


def require_objectives(objectives: Mapping[str, Objective], file: str) -> None:
    """Refuse a spec that nothing can fail.

    Args:
        objectives: the active ones.
        file: the file of the spec, for the message.

    Raises:
        MissingObjectivesError: none of them has the level ``error`` and a requirement.
    """
    if not any(
        objective.level == "error" and objective.require for objective in objectives.values()
    ):
        raise MissingObjectivesError(file)


def gate_changes(base: LoadedSpec, head: LoadedSpec) -> list[GateChange]:
    """Return the differences between the gates of two versions of a spec, both without errors."""
    was, now = base.spec, head.spec
    if was is None or now is None:
        return []
    changes = [*_section_changes(was, now), *_objective_changes(was, now)]
    changes += [*_memory_limits(was, now), *_waiver_changes(base, head)]
    changes += _case_changes(base, head)
    return changes


def allowable_names(*specs: Spec) -> set[str]:
    """Return the names that ``--allow`` may have for some specs, except waivers and specs."""
    names = {ALLOW_BASE, ALLOW_INPUT, "preprocessors"}
    for spec in specs:
        for section in GATED:
            names |= {_name(path) for path in _paths((section,), _builtins(spec, section))}
        names |= {f"objective {name}" for name in spec.slos}
        names |= {f"memory_limit {name}" for name in _limits(spec)}
    return names


def check_allowed(allowed: Iterable[str], known: Collection[str]) -> None:
    """Refuse names that do not exist: a misspelt allowance would have no effect.

    Args:
        allowed: the names that the pipeline allows.
        known: from `allowable_names`, of all specs.

    Raises:
        UsageError: there is one.
    """
    for name in allowed:
        if name in known or _OTHER_NAMES.fullmatch(name):
            continue
        close = did_you_mean(name, known)
        raise UsageError(
            f"--allow {quote(name)}: nothing in the gate has this name"
            + (f"; did you mean {quote(close)}?" if close else ""),
            hint=f"Names are {first_words(sorted(known), _MAX_LISTED)}, 'waiver CODE', "
            "'spec PATH' and 'case NAME'.",
        )


def _diagnostic(change: GateChange, head: LoadedSpec | None, base_name: str) -> Diagnostic:
    """Return the finding at the value in the head, or at its nearest parent if it is gone."""
    span = change.span
    if span is None:
        span = head.span(change.path) if head is not None else Span.of_file("<spec>")
    return Diagnostic(
        WEAKER_GATE,
        Severity.ERROR,
        f"not the gate of {base_name}: {change.name}: {change.text}",
        span,
        path=change.path,
        help=f"{change.way_out}; the pipeline can allow it: --allow {shlex.quote(change.name)}",
    )


def _section_changes(was: Spec, now: Spec) -> Iterator[GateChange]:
    for section in GATED:
        before, after = _builtins(was, section), _builtins(now, section)
        if section == "benchmark" and {before["starts"], after["starts"]} != {None}:
            before["starts"], after["starts"] = was.starts, now.starts
        if section == "monitors":
            after = {name: monitor for name, monitor in after.items() if name in before}
        yield from _differences((section,), before, after)


def _builtins(spec: Spec, section: str) -> Any:
    """Return a section as maps, lists and texts, with the names that a document has."""
    value = msgspec.to_builtins(getattr(spec, section), enc_hook=encode_text)
    if section == "monitors":
        for monitor in value.values():
            monitor.pop("label", None)
    return value


def _differences(path: Path, before: Any, after: Any) -> Iterator[GateChange]:
    if isinstance(before, dict) and isinstance(after, dict):
        for key in before | after:
            below = before.get(key, _ABSENT), after.get(key, _ABSENT)
            yield from _differences((*path, key), *below)
    elif _json(before) != _json(after):
        yield GateChange(_name(path), path, _json(before), _json(after))


def _paths(path: Path, value: Any) -> Iterator[Path]:
    """Yield the paths of all maps and values in a section."""
    yield path
    if isinstance(value, dict):
        for key, below in value.items():
            yield from _paths((*path, key), below)


def _name(path: Path) -> str:
    """Return the name under which a difference at a path is allowed."""
    for parents, noun in _NAMED.items():
        if path[: len(parents)] == parents and len(path) > len(parents):
            return f"{noun} {path[len(parents)]}"
    return "preprocessors" if path[0] == "preprocessors" else ".".join(map(str, path))


def _json(value: Any) -> str:
    """Return a value as brief JSON, a text as it is; empty if it is absent."""
    if value is _ABSENT:
        return ""
    if isinstance(value, str):
        return clip(value, _MAX_TEXT) or "none"
    return "none" if value is None else clip(msgspec.json.encode(value).decode(), _MAX_TEXT)


def _objective_changes(was: Spec, now: Spec) -> Iterator[GateChange]:
    """Yield the base's objectives that the head lacks, or has with other terms or wider limits."""
    active = active_objectives(was).keys(), active_objectives(now).keys()
    for name, before in was.slos.items():
        if before.level != "error":
            continue
        call, path = f"objective {name}", ("slos", name)
        after = now.slos.get(name)
        if after is None:
            yield GateChange(call, path, "; ".join(each.text for each in before.require), "")
            continue
        for key in before.__struct_fields__:
            values = (getattr(objective, key) for objective in (before, after))
            if key != "require":
                shown = (msgspec.to_builtins(value, enc_hook=encode_text) for value in values)
                yield from _differences((*path, key), *shown)
        if name in active[0] - active[1]:
            yield GateChange(call, (*path, "when"), "active", "not active")
        for required in before.require:
            if not any(_implies(other, required) for other in after.require):
                metrics = [each.metric for each in after.require]
                if required.metric in metrics:
                    at = metrics.index(required.metric)
                    text = after.require[at].text
                    yield GateChange(call, (*path, "require", at), required.text, text)
                else:
                    yield GateChange(call, (*path, "require"), required.text, "")


def _implies(head: Requirement, base: Requirement) -> bool:
    """Return True if a requirement is another one, or one with a tighter limit."""
    if head == base:
        return True
    tight, loose = head.bound, base.bound
    if tight is None or loose is None:
        return False
    terms = [
        (
            *(each.metric, each.op),
            *(bound.dimension, bound.of_offered, bound.of_baseline),
        )
        for each, bound in ((head, tight), (base, loose))
    ]
    tighter = {
        "<": tight.value <= loose.value,
        "<=": tight.value <= loose.value,
        ">": tight.value >= loose.value,
        ">=": tight.value >= loose.value,
    }
    return terms[0] == terms[1] and tighter.get(str(head.op), tight.value == loose.value)


def _memory_limits(was: Spec, now: Spec) -> Iterator[GateChange]:
    """Yield limits of resident memory that are gone or higher; the rest of the graph is free."""
    before, after = _limits(was), _limits(now)
    for name, limit in before.items():
        if name not in after or after[name] > limit:
            section = ("containers",) if name in now.containers else ("graph", "nodes")
            path: Path = (*section, name, "memory_limit")
            texts = str(limit), str(after[name]) if name in after else ""
            yield GateChange(f"memory_limit {name}", path, *texts)


def _case_changes(base: LoadedSpec, head: LoadedSpec) -> Iterator[GateChange]:
    """Yield the case of a matrix, if its values are others under the same name."""
    if base.matrix_case is None or head.matrix_case is None:
        return
    before, after = (
        ", ".join(f"{name}: {node.text}" for name, node in sorted(case.values.items()))
        for case in (base.matrix_case, head.matrix_case)
    )
    if before != after:
        span = head.matrix_case.span
        yield GateChange(f"case {base.id}", ("matrix",), before, after, span)


def _limits(spec: Spec) -> dict[str, Any]:
    return {
        name: node.memory_limit
        for name, node in (*spec.graph.nodes.items(), *spec.containers.items())
        if node.memory_limit is not None
    }


def _waiver_changes(base: LoadedSpec, head: LoadedSpec) -> Iterator[GateChange]:
    """Yield waivers that the base does not have."""
    before = _waivers(base)
    for key, waiver in _waivers(head).items():
        if key not in before:
            yield GateChange(f"waiver {waiver.code}", (), "", waiver.reason, waiver.span)


def _waivers(loaded: LoadedSpec) -> dict[tuple[str, Path | str], Waiver]:
    slugs = {code: page.slug for code, page in all_pages().items()}
    waivers = list(effective_waivers(loaded.texts, slugs))
    paths = _paths_by_line(loaded.tree) if waivers and loaded.tree is not None else {}
    return {
        (waiver.code, paths.get((waiver.span.file, waiver.line), waiver.reason)): waiver
        for waiver in waivers
    }


def _paths_by_line(root: TreeNode) -> dict[tuple[str, int], Path]:
    """Return the path of the first key, or item of a list, on each line of each file."""
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
