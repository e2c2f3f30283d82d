"""The folder of a comparison: interleaved runs of a base and of a head.

    spec.yaml          the resolved spec of the head
    plan.json          the plan of the head, with the objectives that are judged
    base.plan.json     the plan of the base
    pairs.json         a `PairsRecord`: the runs of each pair; written after each of them
    base/NNN/          the run folder (`r2bspec.record.run_record`) of the base for pair NNN
    head/NNN/          that of the head
    result.json        metrics of the head and verdicts, computed from all of the above

The folders of a repeated pair are ``NNN-again``.

The runs of a side are merged to one, with the segments of all of them under unique names. Runs on
one machine share a clock (CLOCK_MONOTONIC since boot), so the merged run is equivalent to one run
with pauses. Each iteration keeps its samples; the indices are renumbered.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import numpy as np

from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.plan.plan import Plan
from r2bspec.record.files import FolderReader, RecordError, to_json, write_atomically
from r2bspec.record.graph_identity import common_identity
from r2bspec.record.run_folder import Run, RunFolder, open_run, read_spec_text, read_stored_plan
from r2bspec.record.run_record import (
    Count,
    ExitNumber,
    Limit,
    Number,
    RunRecord,
    SearchRecord,
    Segment,
)
from r2bspec.record.sample_arrays import (
    DEVICE_DTYPE,
    INTERFERENCE_DTYPE,
    RESOURCE_DTYPE,
    Rows,
    SampleKind,
)
from r2bspec.safe_io.limits import MAX_SEGMENTS
from r2bspec.safe_io.safe_file import is_regular

_SEPARATOR = "."


@dataclass(frozen=True)
class MergedRun(Run):
    """Several runs of one plan, merged to a single run.

    Attributes:
        runs: in the order of their pairs.
        spec: the resolved spec of all of them.
    """

    runs: tuple[Run, ...] = ()
    spec: str = ""

    def segment_rows(self, segment: Segment, kind: SampleKind, monitor: str = "") -> Rows:
        """As `Run.segment_rows`."""
        place, source = self._source(segment)
        return self.runs[place].segment_rows(source, kind, monitor)

    def work(self, segment: Segment) -> Rows:
        """See `Run.work`; the processes of each run follow those of the previous one."""
        place, source = self._source(segment)
        rows = self.runs[place].work(source).copy()
        rows["process"] += sum(len(run.record.processes) for run in self.runs[:place])
        return rows

    def _source(self, segment: Segment) -> tuple[int, Segment]:
        """Return the place of the run that has a segment, and the segment there."""
        number, _, own = segment.id.partition(_SEPARATOR)
        return int(number) - 1, msgspec.structs.replace(segment, id=own)

    def resources(self) -> Rows:
        """See `Run.resources`; the processes of each run follow those of the previous one."""
        rows = self._renumbered([run.resources() for run in self.runs])
        return np.concatenate([np.empty(0, RESOURCE_DTYPE), *rows])

    def devices(self) -> Rows:
        """See `Run.devices`; a pair played again has later times than those after it."""
        rows = self._renumbered([run.devices() for run in self.runs])
        return np.concatenate([np.empty(0, DEVICE_DTYPE), *rows])

    def _renumbered(self, of_runs: Sequence[Rows]) -> Iterator[Rows]:
        before = 0
        for run, rows in zip(self.runs, of_runs, strict=True):
            renumbered = rows.copy()
            renumbered["process"][rows["process"] >= 0] += before
            yield renumbered
            before += len(run.record.processes)

    def interference(self) -> Rows:
        """See `Run.interference`; a pair played again has later times than those after it."""
        rows = np.concatenate(
            [np.empty(0, INTERFERENCE_DTYPE), *(run.interference() for run in self.runs)]
        )
        return rows[np.argsort(rows["time_ns"], kind="stable")]

    def spec_text(self) -> str:
        """See `Run.spec_text`."""
        return self.spec


def merge_runs(
    runs: Sequence[Run], *, folder: Path, plan: Plan, whole: RunRecord, spec: str = ""
) -> MergedRun:
    """Merge runs.

    Args:
        runs: may be empty.
        folder: contains all of them.
        plan: of all of them.
        whole: the record of the merged run, without the merged fields.
        spec: the resolved spec.
    """
    records = [run.record for run in runs]
    counts: dict[tuple[str, float], int] = {}
    segments: list[Segment] = []
    starts = 0
    for number, record in enumerate(records, start=1):
        for played in record.segments:
            key = (played.kind, played.rate_hz)
            # A repetition has the index of the segment that it replaces.
            counts[key] = counts.get(key, 0) + (not played.rerun_of)
            segments.append(
                msgspec.structs.replace(
                    played,
                    id=prefixed_id(number, played.id),
                    index=counts[key],
                    rerun_of=prefixed_id(number, played.rerun_of) if played.rerun_of else "",
                    start=starts + played.start,
                )
            )
        # Each run has processes of its own.
        starts += max((segment_record.start for segment_record in record.segments), default=0)
    merged = msgspec.structs.replace(
        whole,
        processes=tuple(process for record in records for process in record.processes),
        segments=tuple(segments),
        search=_search(records),
        sustained=tuple(
            msgspec.structs.replace(probe, segment=prefixed_id(number, probe.segment))
            for number, record in enumerate(records, start=1)
            for probe in record.sustained
        ),
        events=tuple(event for record in records for event in record.events),
        confirmation=None,
        output_gaps=tuple(output_gap for record in records for output_gap in record.output_gaps),
        differences=records[0].differences if records else (),
        left_out=tuple(dict.fromkeys(text for record in records for text in record.left_out)),
        unplayed=tuple(dict.fromkeys(text for record in records for text in record.unplayed)),
        # Every run compares the same images; the first one that did so speaks for all.
        identity=common_identity(record.identity for record in records or [whole]),
        gate=whole.gate,
    )
    return MergedRun(folder=folder, record=merged, plan=plan, runs=tuple(runs), spec=spec)


def prefixed_id(number: int, own: str) -> str:
    """Return the id of a segment in a merged run, from the number of its run and its id there."""
    return f"{number:03d}{_SEPARATOR}{own}"


def _search(records: Sequence[RunRecord]) -> SearchRecord | None:
    """Return the bracket that contains the brackets of all runs."""
    searches = [record.search for record in records if record.search is not None]
    if not searches:
        return None
    holds = [search.holds_hz for search in searches if search.holds_hz is not None]
    fails = [search.fails_hz for search in searches if search.fails_hz is not None]
    losses = [search.lost_at_most for search in searches if search.lost_at_most is not None]
    limits = {search.limited_by for search in searches}
    proofs = {search.proof for search in searches}
    order: tuple[Limit, ...] = ("interrupted", "player", "interference", "range", "graph")
    return SearchRecord(
        probes=tuple(
            msgspec.structs.replace(probe, segment=prefixed_id(number, probe.segment))
            for number, record in enumerate(records, start=1)
            for probe in (record.search.probes if record.search is not None else ())
        ),
        holds_hz=min(holds) if len(holds) == len(searches) else None,
        fails_hz=max(fails) if len(fails) == len(searches) else None,
        limited_by=next(limit for limit in order if limit in limits),
        precision=max(search.precision for search in searches),
        confidence=min(search.confidence for search in searches),
        proof=next((proof for proof in ("open", "probes", "confirmed") if proof in proofs), ""),
        proof_s=min(search.proof_s for search in searches),
        lost_at_most=max(losses) if len(losses) == len(searches) else None,
        max_lost=max((search.max_lost or 0.0 for search in searches), default=None) or None,
        unsteady=tuple(dict.fromkeys(text for search in searches for text in search.unsteady)),
        unsteady_ratio=max(search.unsteady_ratio for search in searches),
        watched_s=min(search.watched_s for search in searches),
        refuted=next((search.refuted for search in searches if search.refuted), ""),
    )


PAIRS_FILE = "pairs.json"
BASE_PLAN_FILE = "base.plan.json"

COMPARISON_FILES: Final = FolderReader(
    "comparison", "The folder is incomplete; repeat the comparison."
)

Side = Literal["base", "head"]


class PairRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A run of the base and a run of the head, one directly after the other.

    Attributes:
        number: from 1; a repeated pair has a record with the same number.
        order: of the runs; in ``AB`` the base is first.
        base: the folder of its run, relative to the folder of the comparison.
        head: likewise.
        again: whether it is the repetition of another pair.
        unusable: why it cannot be judged; otherwise empty.
    """

    number: Number
    order: Literal["AB", "BA"]
    base: str
    head: str
    again: bool = False
    unusable: str = ""

    def folder(self, side: Side) -> str:
        """Return the folder of one of its runs, relative to that of the comparison."""
        return self.base if side == "base" else self.head


class PairsRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A comparison, complete or not.

    Attributes:
        against: the base, as given by the user; empty if the head is compared with itself.
        control: whether base and head are equal, so that every difference is noise.
        seed: of the coin that decided the order of the two sides in each pair.
        planned: the largest number of pairs before a failure; fewer are played where they decide.
        differences: between the plans of the base and the head, one per line.
        environment: the changed variables of the base, by name; empty for a removed one.
        notes: on decisions during the comparison, one sentence each.
        gate: on the base, if it has its own work tree, one sentence each.
        by_turns: whether a pair is a start of both sides, which were played by turns.
        confirmed_from: after so many pairs a requirement failed; those that follow confirm it. 0
            where nothing had to be confirmed.
        fresh: the largest number of pairs that confirm it.
    """

    r2bspec_pairs: Literal[1] = 1
    run_id: str
    head_plan: str
    base_plan: str
    against: str
    control: bool
    seed: int = 0
    planned: Number
    started_at: str
    ended_at: str
    status: Literal["complete", "incomplete"]
    reason: str
    pairs: tuple[PairRecord, ...]
    differences: tuple[str, ...] = ()
    environment: dict[str, str] = {}
    notes: tuple[str, ...] = ()
    gate: tuple[str, ...] = ()
    by_turns: bool = False
    confirmed_from: Count = 0
    fresh: Count = 0
    exit_status: ExitNumber = 0


class ComparisonFolder(RunFolder):
    """The folder of a comparison that is being written."""

    def write_base_plan(self, plan: Plan) -> None:
        """Write the plan of the base."""
        write_atomically(self.path / BASE_PLAN_FILE, canonical_json(plan))

    def write_pairs(self, record: PairsRecord) -> None:
        """Write ``pairs.json``; it is written again after each run."""
        write_atomically(self.path / PAIRS_FILE, to_json(record))


@dataclass(frozen=True)
class PairedComparison:
    """A comparison that has been opened.

    Attributes:
        opened: its runs that have been opened before, by their folders.
    """

    folder: Path
    record: PairsRecord
    plan: Plan
    base_plan: Plan
    opened: dict[str, Run] = field(default_factory=dict)

    def usable_pairs(self) -> tuple[PairRecord, ...]:
        """Return the pairs that count: for each number the first usable pair."""
        pairs: dict[int, PairRecord] = {}
        for pair in self.record.pairs:
            if not pair.unusable:
                pairs.setdefault(pair.number, pair)
        return tuple(pairs[number] for number in sorted(pairs))

    def run(self, pair: PairRecord, side: Side) -> Run:
        """Return a run of a pair.

        Raises:
            RecordError: its folder is missing or damaged.
        """
        folder = pair.folder(side)
        if folder not in self.opened:
            self.opened[folder] = open_run(self.folder / folder)
        return self.opened[folder]

    def merged(self, pairs: Sequence[PairRecord], side: Side) -> MergedRun:
        """Return the runs of one side of some pairs as a merged run.

        Raises:
            RecordError: a folder is missing or damaged.
        """
        runs = [self.run(pair, side) for pair in pairs]
        plan = self.base_plan if side == "base" else self.plan
        return merge_runs(
            runs,
            folder=self.folder,
            plan=plan,
            whole=self._merged_record(plan, runs or self._fallback_runs(side)),
            spec=self.spec_text() if side == "head" else "",
        )

    def spec_text(self) -> str:
        """Return the resolved spec of the head; empty if the folder has none."""
        return read_spec_text(self.folder / "spec.yaml")

    def _fallback_runs(self, side: Side) -> list[Run]:
        """Return a run with machine and versions, if no pair is usable."""
        for pair in self.record.pairs:
            folder = self.folder / pair.folder(side)
            if (folder / "record.json").exists():
                return [open_run(folder)]
        return []

    def _merged_record(self, plan: Plan, runs: Sequence[Run]) -> RunRecord:
        record = self.record
        facts: dict[str, Any] = {"dataset": {}, "machine": {}, "versions": {}, "identity": None}
        if runs:
            facts = {name: getattr(runs[0].record, name) for name in facts}
        return RunRecord(
            run_id=record.run_id,
            plan_hash=plan_hash(plan),
            started_at=record.started_at,
            ended_at=record.ended_at,
            status=record.status,
            reason=record.reason,
            exit_status=record.exit_status,
            processes=(),
            segments=(),
            search=None,
            sustained=(),
            events=(),
            gate=record.gate,
            **facts,
        )


def is_comparison(path: Path) -> bool:
    """Return True if a folder is the folder of a comparison."""
    return is_regular(path / PAIRS_FILE)


def open_comparison(path: Path, opened: dict[str, Run] | None = None) -> PairedComparison:
    """Open a comparison.

    Args:
        path: its folder.
        opened: its runs that have been opened before; those that are opened are added.

    Raises:
        RecordError: a file is missing or damaged, or has an unknown format version.
    """
    folder = path.absolute()
    record = COMPARISON_FILES.versioned(
        folder / PAIRS_FILE,
        PairsRecord,
        "r2bspec_pairs",
        missing="Give the folder of a comparison, which contains pairs.json.",
    )
    _check_pairs(folder / PAIRS_FILE, record)
    return PairedComparison(
        folder=folder,
        record=record,
        plan=read_stored_plan(COMPARISON_FILES, folder / "plan.json", record.head_plan),
        base_plan=read_stored_plan(COMPARISON_FILES, folder / BASE_PLAN_FILE, record.base_plan),
        opened={} if opened is None else opened,
    )


def _check_pairs(path: Path, record: PairsRecord) -> None:
    """Check that each run belongs to one pair, and that there are not too many.

    Raises:
        RecordError: they do not, or are.
    """
    most = max(len(record.pairs), record.planned)
    if most > MAX_SEGMENTS:
        raise RecordError(
            f"{path} has {most:,} pairs; the limit is {MAX_SEGMENTS:,}",
            hint=COMPARISON_FILES.changed,
        )
    runs = (folder for pair in record.pairs for folder in (pair.base, pair.head))
    COMPARISON_FILES.require_once(path, "run", runs)
