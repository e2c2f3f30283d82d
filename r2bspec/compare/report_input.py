"""The input of a report: the result, and the run folder if there is one.

The folder of a run, or of a comparison of interleaved runs, is measured and judged again; a
``result.json`` is read as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import msgspec

from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.judge.decision_policy import decision_policy
from r2bspec.judge.judge_run import build_result, from_json, result_of
from r2bspec.judge.measure.anatomy_summary import anatomy_summaries
from r2bspec.judge.measure.metrics import summarise
from r2bspec.judge.measure.run_samples import merged_samples, read_samples
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pair_comparison import Pairs, judge_comparison
from r2bspec.judge.result import PairsResult, Result
from r2bspec.language.spec import Objective
from r2bspec.plan.comparability import pair_count
from r2bspec.plan.interim_looks import InterimLooks
from r2bspec.plan.plan import GatePlan
from r2bspec.record import comparison_folder
from r2bspec.record.run_folder import Run, open_run
from r2bspec.safe_io.file_search import path_hint
from r2bspec.safe_io.limits import MAX_JSON_BYTES
from r2bspec.safe_io.safe_file import is_folder, is_there, read_bytes


class SamplesMissingError(R2bspecError):
    """Only the result of a run is known, but its samples are needed."""

    code = "R2B661"
    exit_code = ExitStatus.USAGE


class UnreadableResultError(R2bspecError):
    """A file is not a result."""

    code = "R2B662"
    exit_code = ExitStatus.USAGE
    way_out = "Name a run folder or a result.json."


@dataclass(frozen=True)
class ReportInput:
    """A result, and the run folder that it was computed from.

    Attributes:
        result: shown by every report.
        run: the opened run folder, with plan and samples; None where only the result is known.
        spec_file: the spec whose objectives were judged, as the user named it, so that a report
            can refer to its lines; None where it is not known.
        verbose: with every reason and every note; a report is short otherwise.
        suite_page: the HTML page of the suite that the run belongs to, if it has one.
        suite_link: the same, as a link of the page that is being written.
        judged_samples: of the run, where they have been read for the result.
    """

    result: Result
    run: Run | None = None
    spec_file: Path | None = None
    verbose: bool = False
    suite_page: Path | None = None
    suite_link: str = ""
    judged_samples: RunSamples | None = None

    def require_run(self, what: str) -> Run:
        """Return the run folder, for a format that needs it.

        Raises:
            SamplesMissingError: only the result is known.
        """
        if self.run is None:
            raise SamplesMissingError(
                f"{what} needs the samples of the run, but only its result was given",
                hint="Name the run folder instead of its result.json.",
            )
        return self.run

    @cached_property
    def samples(self) -> RunSamples | None:
        """All matched samples of the run, read once; None without a run folder."""
        if self.judged_samples is not None or self.run is None:
            return self.judged_samples
        return read_samples(self.run)


def require_there(path: Path) -> None:
    """Refuse a path that leads to nothing.

    Raises:
        UnreadableResultError: it does.
    """
    if not is_there(path):
        raise UnreadableResultError(f"{path} does not exist", hint=path_hint(path))


def read_report_input(path: Path, *, spec_file: Path | None = None) -> ReportInput:
    """Return the input of a report: a folder is measured and judged again, a file is read as it is.

    Raises:
        RecordError: a folder is neither that of a run nor of a comparison.
        UnreadableResultError: a file is not a result.
    """
    if is_folder(path):
        return read_folder(path, spec_file=spec_file)
    return ReportInput(result=read_result(path), spec_file=spec_file)


def read_folder(
    path: Path,
    *,
    spec_file: Path | None = None,
    objectives: Mapping[str, Objective] | None = None,
    judged_by: str = "",
    gate: GatePlan | None = None,
) -> ReportInput:
    """Measure and judge the folder of a run, or of a comparison, again.

    Args:
        path: the folder.
        spec_file: the spec whose objectives are judged, where it is known.
        objectives: to judge by, if not the folder's own objectives.
        judged_by: the name of the spec of `objectives`.
        gate: of that spec, if not the folder's own.

    Raises:
        RecordError: it is neither, or a file of it is missing or damaged.
        UnreadableResultError: it does not exist.
    """
    require_there(path)
    if comparison_folder.is_comparison(path):
        pairs = comparison_folder.open_comparison(path)
        judged = judge_comparison_folder(pairs, objectives, judged_by, gate)
        return replace(judged, spec_file=spec_file)
    run = open_run(path)
    samples = read_samples(run)
    return ReportInput(
        result=result_of(run, objectives, judged_by, gate, samples),
        run=run,
        spec_file=spec_file,
        judged_samples=samples,
    )


def judge_comparison_folder(
    pairs: comparison_folder.PairedComparison,
    objectives: Mapping[str, Objective] | None = None,
    judged_by: str = "",
    gate: GatePlan | None = None,
    measured: dict[str, RunSamples] | None = None,
) -> ReportInput:
    """Measure and judge a comparison, without ROS; the same folder gives the same bytes.

    The run is that of the head in the pairs that count, joined.

    Args:
        pairs: the opened comparison.
        objectives: to judge by; those of the head if None.
        judged_by: the name of the spec of `objectives`, if it is another.
        gate: of that spec; that of the head if None.
        measured: as for `read_pairs`.

    Raises:
        RecordError: a file of one of its runs is missing or damaged.
    """
    measured = {} if measured is None else measured
    objectives = pairs.plan.objectives if objectives is None else objectives
    counted = pairs.usable_pairs()
    base, head = pairs.merged(counted, "base"), pairs.merged(counted, "head")
    played = read_pairs(pairs, measured)
    verdict = judge_comparison(objectives, played, decision_policy(pairs.plan, gate))
    result = build_result(
        head,
        objectives,
        judged_by,
        metrics=summarise(played.merged),
        verdict=verdict,
        pairs=_pairs_result(pairs),
        base_identity=base.record.identity,
        anatomies=anatomy_summaries(
            head, measured[counted[-1].folder("head")].summaries if counted else None
        ),
    )
    return ReportInput(result=result, run=head, judged_samples=played.merged)


def read_pairs(pairs: comparison_folder.PairedComparison, measured: dict[str, RunSamples]) -> Pairs:
    """Return the samples of the pairs that count, and the looks at which they are judged.

    Args:
        pairs: the comparison.
        measured: its runs that have been measured before, by their folders; others are added.

    Raises:
        RecordError: a file of one of the runs is missing or damaged.
    """
    record, counted = pairs.record, pairs.usable_pairs()

    def samples(side: comparison_folder.Side) -> list[RunSamples]:
        for pair in counted:
            if pair.folder(side) not in measured:
                measured[pair.folder(side)] = read_samples(pairs.run(pair, side))
        return [measured[pair.folder(side)] for pair in counted]

    head = samples("head")
    failed = sum(pair.number <= record.confirmed_from for pair in counted)
    fresh = len(counted) - failed if record.confirmed_from else 0
    looks = InterimLooks.after_pairs(failed, len(counted)) if fresh and failed else None
    tried = len({pair.number for pair in record.pairs})
    if record.by_turns and not record.control:
        last = record.confirmed_from + record.fresh or record.planned
        # Looks come after starts that can be judged.
        last = max(1, last - (tried - len(counted)))
        declared = pair_count(pairs.plan)
        looks = InterimLooks.after_starts_of_both(
            last, declared, failed if record.confirmed_from else 0
        )
    noun = "starts of both sides" if record.by_turns else "pairs"
    return Pairs(
        base=samples("base"),
        head=head,
        merged=merged_samples(pairs.merged(counted, "head"), head),
        tried=tried,
        looks=looks,
        confirms=f"{fresh} more {noun}" if fresh else "",
    )


def _pairs_result(pairs: comparison_folder.PairedComparison) -> PairsResult:
    record = pairs.record
    return PairsResult(
        against=record.against,
        control=record.control,
        base_plan=record.base_plan,
        differences=record.differences,
        environment=record.environment,
        planned=record.planned,
        used=len(pairs.usable_pairs()),
        pairs=record.pairs,
        notes=record.notes,
        by_turns=record.by_turns,
    )


def read_result(path: Path) -> Result:
    """Read a ``result.json``.

    Raises:
        UnreadableResultError: it does not exist, or is not a result.
    """
    require_there(path)
    try:
        return from_json(read_bytes(path, max_bytes=MAX_JSON_BYTES))
    except OSError as error:
        raise UnreadableResultError(f"{path} cannot be read: {error.strerror or error}") from error
    except msgspec.DecodeError as error:
        raise UnreadableResultError(
            f"{path} is not a result of this version: {error}",
            hint="Name a run folder or the result.json in it.",
        ) from error
