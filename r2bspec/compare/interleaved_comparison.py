"""A comparison from its two sides to its result: checked, played, and judged."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from r2bspec.compare.errors import IncomparableError
from r2bspec.compare.interleaved_runs import (
    CheckRun,
    ComparisonSide,
    ComparisonSpec,
    run_pairs,
)
from r2bspec.compare.judge_pairs import judge_comparison_folder
from r2bspec.errors import R2bspecError
from r2bspec.execute.errors import WorkspaceError
from r2bspec.execute.processes.environment import inherited_environment
from r2bspec.execute.processes.machine import check_machine
from r2bspec.execute.processes.prerequisites import check_middleware
from r2bspec.execute.progress import NullProgress, Progress
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.result import Result
from r2bspec.plan.comparability import (
    difference_lines,
    graph_differences,
    load_differences,
    pair_count,
)
from r2bspec.private_files import private_files
from r2bspec.record.comparison_folder import ComparisonFolder, open_comparison


@dataclass(frozen=True)
class Gate:
    """A base with its own work tree.

    Attributes:
        sentences: what reports say of it.
        check_run: checks that a side has loaded its own files.
    """

    sentences: tuple[str, ...]
    check_run: CheckRun


def prepare_comparison(
    base: ComparisonSide,
    head: ComparisonSide,
    *,
    against: str,
    pairs: int | None = None,
    control: bool = False,
    force: bool = False,
    gate: Gate | None = None,
) -> ComparisonSpec:
    """Check that two sides are comparable.

    Args:
        base: to compare with.
        head: to be judged.
        against: the base, as the user named it.
        pairs: how many; as many as the head's spec has iterations if None.
        control: whether base and head are meant to be the same.
        force: compare even with different loads.
        gate: what is said of a base with its own work tree, which may have the same plan.

    Raises:
        IncomparableError: the two are offered different loads, or are the same.
        MiddlewareError: the middleware of one of them has no such transport.
    """
    differences = graph_differences(base.plan, head.plan)
    if not control and not differences and not base.environment and gate is None:
        raise IncomparableError(
            f"the base, {against}, is the same as the head",
            hint="Use --control to compare a graph with itself and see the noise.",
        )
    otherwise = load_differences(base.plan, head.plan)
    if otherwise and not force:
        raise IncomparableError(
            "base and head differ in load or monitors:\n"
            + "\n".join(f"  {each}" for each in difference_lines(otherwise)),
            hint="Use --force to compare them anyway.",
        )
    _check_environment_inherited(head, base.environment)
    for one in (base, head):
        check_middleware(one.plan, {**os.environ, **one.environment})
    return ComparisonSpec(
        base=base,
        head=head,
        pairs=pairs or pair_count(head.plan),
        against=against,
        control=control,
        differences=tuple(difference_lines(differences)),
        gate=gate.sentences if gate is not None else (),
        check_run=gate.check_run if gate is not None else None,
    )


def _check_environment_inherited(head: ComparisonSide, environment: Mapping[str, str]) -> None:
    """Check that processes of a run inherit the variables; most are not inherited."""
    arrives = inherited_environment(environment, head.plan.environment)
    if environment and not arrives:
        raise WorkspaceError(
            f"no process of a run inherits {', '.join(sorted(environment))}",
            hint="List the variables that nodes need under 'environment' in the spec.",
        )


def compare(comparison: ComparisonSpec, output: Path, progress: Progress | None = None) -> Result:
    """Play interleaved pairs on real ROS 2, and judge them.

    Args:
        comparison: to be made.
        output: the folder of the comparison, new or empty.
        progress: is notified of progress.

    Raises:
        RunError: a run failed; the folder has the pairs finished until then.
        OtherMachineError: this machine is not what the spec requires.
        RecordError: the folder cannot be created.
    """
    check_machine(comparison.head.plan)
    with private_files(), ComparisonFolder.create(output) as folder:
        try:
            run_pairs(comparison, folder, progress or NullProgress())
        except R2bspecError:
            # Write a result of what was measured, marked as incomplete; if that fails, too, the
            # first failure is reported.
            with contextlib.suppress(R2bspecError, OSError):
                _write_result(folder)
            raise
        return _write_result(folder)


def _write_result(folder: ComparisonFolder) -> Result:
    result = judge_comparison_folder(open_comparison(folder.path)).result
    folder.write_result(to_json(result))
    return result
