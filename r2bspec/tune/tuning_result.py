"""What a search for a deployment found, as frozen values: they are stored, resumed and reported.

In ``tuning.json`` they are canonical JSON: UTF-8, sorted keys, indentation of two spaces, a newline
at the end. JSON has no infinity, which a margin has where messages were lost: it is written as
`MAX_NUMBER`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any, Final, Literal

import msgspec

from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.plan.tuning_space import Deployment, TuningSpace
from r2bspec.record.files import FolderReader, RecordError, write_atomically
from r2bspec.record.graph_identity import GraphIdentity
from r2bspec.safe_io.limits import MAX_NUMBER

TUNING_FILE: Final = "tuning.json"

_FILES: Final = FolderReader("search", "Give the folder of a search by 'r2bspec tune'.")

TrialState = Literal["meets", "misses", "open", "broken", "refused", "invalid"]
"""Whether a deployment meets the objectives, as far as its starts show. ``open``: they do not
decide. ``broken``: the graph did not work. ``refused``: the spec is not valid with it, or the
system does not permit it, so nothing was started. ``invalid``: the machine could not play the load,
which says nothing of the deployment."""


MAX_EXCESS: Final = 3.0
"""The largest, such as that of the latency of messages that never arrive."""


class RequirementMargin(msgspec.Struct, frozen=True, kw_only=True):
    """How far one requirement is from its limit.

    Attributes:
        text: the requirement as the user wrote it, with its rate where there are several.
        outcome: as judged.
        estimate: of the metric, in `unit`; None where it has no value.
        limit: in `unit`.
        unit: of both: ``s``, ``Hz``, ``share``, ``B``.
        excess: by how much the estimate is beyond the limit, as the logarithm of their ratio (0.12
            is about 12 %); at most 0 where it is kept, and at most `MAX_EXCESS`.
    """

    text: str
    outcome: Literal["pass", "fail", "inconclusive"]
    estimate: float | None
    limit: float | None
    unit: str
    excess: float


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """One deployment that was tried.

    Attributes:
        number: from 0, which is today's deployment.
        cost: the metric to be least, in one start; None where nothing was measured.
        starts: of all processes, that were played and judged.
        duration_s: that the trial took, all of it.
        reason: one sentence: why it is broken or refused, or which requirement it misses most.
        run: the folder of its run below that of the trials; empty if there is none.
        anatomy: of the nearest trial where none meets the objectives: what takes most of its
            latency, such as ``detector: callback takes 41 ms of 58 ms``; otherwise empty.
    """

    number: int
    deployment: Deployment
    state: TrialState
    cost: float | None
    margins: tuple[RequirementMargin, ...] = ()
    starts: int = 0
    duration_s: float = 0.0
    reason: str = ""
    run: str = ""
    anatomy: str = ""

    @property
    def excess(self) -> float:
        """By how much it misses the requirement that it misses most; at most 0 if it meets all."""
        return max((margin.excess for margin in self.margins), default=0.0)


class Gain(msgspec.Struct, frozen=True, kw_only=True):
    """What a change of the deployment gives, from interleaved pairs of runs in new processes.

    Attributes:
        change: what was changed, in words: a lever with its setting, or all of them.
        lever: its name; empty for all of them together.
        metric: what was compared.
        unit: of `before` and `after`.
        before: the geometric mean over the runs without the change; None where one is missing.
        after: likewise with it.
        ratio: of after to before; None where it cannot be had.
        lower: the bound of its interval; None where there is none.
        upper: likewise.
        pairs: that were played.
        confidence: of the interval.
    """

    change: str
    lever: str
    metric: str
    unit: str
    before: float | None = None
    after: float | None = None
    ratio: float | None = None
    lower: float | None = None
    upper: float | None = None
    pairs: int = 0
    confidence: float = CONFIDENCE

    @property
    def is_shown(self) -> bool:
        """Whether the pairs show that the change makes the metric less."""
        return self.upper is not None and self.upper < 1.0


TuningOutcome = Literal["improved", "met today", "meets", "not met", "not shown", "incomplete"]
"""``improved``: the winner costs less than today's deployment, which meets the objectives, too, and
pairs show it. ``meets``: the winner meets the objectives, and today's does not, or is not shown to.
``met today``: today's does, and nothing is shown to cost less. ``not met``: no deployment meets
them. ``not shown``: no deployment is shown to. ``incomplete``: the search did not end."""


class TuningResult(msgspec.Struct, frozen=True, kw_only=True):
    """A search and its proof.

    Attributes:
        name: of the benchmark.
        goal: the metric that is least, with its rate: ``cpu.graph.mean at 30 Hz``.
        goal_unit: its unit.
        reason: the outcome in one sentence.
        winner: the deployment that is proposed, without the levers that give nothing; None if
            there is none.
        proof: of the winner against today's deployment; None if that was not played.
        requirements: of the winner, as the pairs of the proof judge them, or its own runs where
            today's deployment does not work.
        levers: what each lever of the winner gives: the winner against itself without the lever.
        dropped: levers of the search's best deployment that give nothing, with the gain measured.
        unproven: what the search saw as the winner's cost; to be compared with the proof.
        for_others: what the winner changes for other programs of the machine.
        predicted: deployments that a model ruled out before they were tried, a sentence each.
        notes: what the reader has to know of the search itself.
        seed: of the proposals.
        budget_s: the time that the search was given, proof included.
        max_trials: the most trials that it was permitted.
        max_pairs: likewise of the proof.
        duration_s: that it took.
        proofs: that were judged, in all calls.
        plan: the hash of the plan of today's deployment, with its objectives.
        identity: the code of its graph; trials of other code say nothing of it.
        machine_class: costs of another class of machines cannot be compared with these.
    """

    r2bspec_tuning: Literal[1] = 1
    name: str
    title: str
    goal: str
    goal_unit: str
    outcome: TuningOutcome
    reason: str
    space: TuningSpace
    trials: tuple[Trial, ...]
    winner: Deployment | None = None
    proof: Gain | None = None
    requirements: tuple[RequirementMargin, ...] = ()
    levers: tuple[Gain, ...] = ()
    dropped: tuple[Gain, ...] = ()
    unproven: float | None = None
    for_others: tuple[str, ...] = ()
    predicted: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    seed: int = 0
    budget_s: float = 0.0
    max_trials: int = 0
    max_pairs: int = 0
    duration_s: float = 0.0
    proofs: int = 0
    plan: str = ""
    identity: GraphIdentity | None = None
    machine_class: str = ""
    started_at: str = ""
    machine: dict[str, object] = {}

    @property
    def is_proved(self) -> bool:
        """Whether pairs show what is claimed of the winner."""
        return self.outcome in {"improved", "meets"}


def to_json(result: TuningResult) -> bytes:
    """The canonical form of a result.

    Raises:
        ValueError: a number of it is none.
    """
    plain = _with_numbers(
        msgspec.to_builtins(result), {math.inf: MAX_NUMBER, -math.inf: -MAX_NUMBER}
    )
    text = msgspec.json.encode(plain, order="sorted")
    return escaped_json(msgspec.json.format(text, indent=2) + b"\n")


def write_tuning(folder: Path, result: TuningResult) -> None:
    """Write a result into the folder of its search, as a whole or not at all.

    Raises:
        RecordError: it cannot be written.
    """
    write_atomically(folder / TUNING_FILE, to_json(result))


def read_tuning(folder: Path) -> TuningResult:
    """Read the result of a search.

    Raises:
        RecordError: the file cannot be read, is damaged, of another version, or contradicts itself.
    """
    path = folder / TUNING_FILE
    content: dict[str, Any] = _FILES.versioned(path, dict, "r2bspec_tuning")
    plain = _with_numbers(content, {MAX_NUMBER: math.inf, -MAX_NUMBER: -math.inf})
    try:
        result = msgspec.convert(plain, TuningResult)
    except msgspec.ValidationError as error:
        raise RecordError(f"{path} is damaged: {error}", hint=_FILES.changed) from error
    for contradiction in _contradictions(result):
        raise RecordError(f"{path} is damaged: {contradiction}", hint=_FILES.changed)
    return result


def _with_numbers(value: Any, numbers: dict[float, float]) -> Any:
    """Plain data with some floating-point numbers replaced by others."""
    if isinstance(value, dict):
        return {key: _with_numbers(item, numbers) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_with_numbers(item, numbers) for item in value]
    if isinstance(value, float):
        if math.isnan(value):
            raise ValueError("not a number")
        return numbers.get(value, value)
    return value


def _contradictions(result: TuningResult) -> Iterator[str]:
    """What no search writes: a reader would resume, or open, something else."""
    if [trial.number for trial in result.trials] != list(range(len(result.trials))):
        yield "its trials are not numbered from 0"
    deployments = [trial.deployment for trial in result.trials]
    if result.winner is not None:
        deployments.append(result.winner)
    known = {
        (lever.name, place, setting)
        for lever in result.space.levers
        for place, setting in enumerate(lever.settings)
    }
    for deployment in deployments:
        for choice in deployment.choices:
            if (choice.lever, choice.place, choice.setting) not in known:
                yield f"its space has no setting {choice.place} of {choice.lever!r}"
    for trial in result.trials:
        run = PurePosixPath(trial.run)
        if run.is_absolute() or ".." in run.parts:
            yield f"the run of trial {trial.number} is outside of the folder"
