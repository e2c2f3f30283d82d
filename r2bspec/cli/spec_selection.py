"""The runs that a command line selects: specs with their cases and scanned values.

Each spec is prepared here, and its findings printed; several specs are the entries of a suite.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.text_output import show_findings
from r2bspec.errors import R2bspecError
from r2bspec.language.selected_spec import SpecSelection as SpecSelection

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.compare.base_reference import BaseReference
    from r2bspec.language.load_spec import LoadedSpec
    from r2bspec.plan.time_estimate import TimeEstimate
    from r2bspec.report.suite import SuiteRun

ALL_CASES = "all"
"""The value of ``--case`` that selects every case of a matrix."""


def prepare_and_report(
    selection: SpecSelection,
    *,
    smoke: bool = False,
    infos: bool = True,
) -> PreparedBenchmark:
    """Prepare a spec, or a smoke run of it; findings are printed to standard error.

    Args:
        selection: the spec.
        smoke: prepare a smoke run.
        infos: print findings of severity info, too.

    Raises:
        InvalidSpecError: it has errors.
        PlanError: the file is not a valid plan.
        DataError: the bag does not exist or is not readable.
    """
    from r2bspec import api
    from r2bspec.diagnostics import Severity

    try:
        prepared = api.prepare(selection, smoke=smoke)
    except api.InvalidSpecError as error:
        show_findings(error.diagnostics, error.loaded)
        raise
    if prepared.loaded is not None:
        shown = [
            diagnostic
            for diagnostic in prepared.diagnostics
            if infos or diagnostic.severity != Severity.INFO
        ]
        show_findings(shown, prepared.loaded)
    return prepared


def base_selection(head: SpecSelection, reference: BaseReference) -> SpecSelection:
    """Return the base of a reference.

    With the head's own spec it has the head's options of the command line, changed by the
    reference. Another spec has only the options of the reference.
    """
    if reference.spec is not None:
        return replace(
            head,
            spec=reference.spec,
            sets=reference.sets,
            variables=dict(reference.variables),
            case="",
        )
    return replace(
        head,
        sets=(*head.sets, *reference.sets),
        variables={**(head.variables or {}), **reference.variables},
    )


@dataclass
class SuiteEntry:
    """A run of a suite.

    Attributes:
        suffix: added to the name of the benchmark, such as ``[rate=5 Hz]`` of a scan.
        prepared: None if the spec has errors; the first of them is `error` then.
        host: of a fleet, if the run is made on that host; empty if any may make it, and here.
        folder: the folder of the run.
        run: its row in the summary, once it has ended or is skipped.
    """

    selection: SpecSelection
    suffix: str = ""
    name: str = ""
    prepared: PreparedBenchmark | None = None
    error: R2bspecError | None = None
    estimate: TimeEstimate | None = None
    folder: Path = field(default_factory=Path)
    host: str = ""
    run: SuiteRun | None = None

    @property
    def benchmark(self) -> PreparedBenchmark:
        """The benchmark of an entry without an error."""
        assert self.prepared is not None  # noqa: S101 - it has an error otherwise
        return self.prepared

    @property
    def seconds(self) -> float:
        """The expected time of the run."""
        return self.estimate.seconds if self.estimate is not None else 0.0


def suite_entries(
    selection: SpecSelection,
    files: Sequence[str],
    scan: Sequence[str] = (),
) -> list[SuiteEntry]:
    """Return every run, in the order of files, cases and scanned values.

    A matrix is run with all its cases, unless the selection names one.

    Args:
        selection: the options that apply to each file.
        files: specs and plans.
        scan: ``NAME=VALUE,VALUE``; each combination of the values is a run.

    Raises:
        click.UsageError: an option is malformed.
    """
    scans = [_parse_scan(text) for text in scan]
    return [
        entry
        for file in files
        for loaded, case in _cases_of(replace(selection, spec=Path(file)))
        for entry in _scanned(replace(selection, spec=Path(file), case=case), loaded, scans)
    ]


def _cases_of(selection: SpecSelection) -> Iterator[tuple[LoadedSpec | None, str]]:
    """Yield the cases of a file; a plan has one, and so has a document with errors."""
    if selection.spec.suffix == ".json":
        yield None, ""
        return
    case_name = "" if selection.case == ALL_CASES else selection.case
    cases = replace(selection, case=case_name).load_cases()
    for loaded in cases:
        # An unknown case stays: its error is that of the run.
        case = selection.case if selection.case != ALL_CASES else ""
        yield loaded, loaded.case or case


def _parse_scan(text: str) -> tuple[str, tuple[str, ...]]:
    name, equals, rest = text.partition("=")
    values = tuple(value.strip() for value in rest.split(",") if value.strip())
    if not equals or not name or not values:
        raise click.UsageError(f"--scan takes NAME=VALUE,VALUE..., not {text!r}")
    return name, values


def _scanned(
    selection: SpecSelection,
    loaded: LoadedSpec | None,
    scans: Sequence[tuple[str, tuple[str, ...]]],
) -> Iterator[SuiteEntry]:
    """Yield the runs of one case: a variable of the spec is set, or else the key of that path."""
    spec = loaded.spec if loaded is not None else None
    declared = spec.variables if spec is not None else {}
    for values in itertools.product(*(axis for _, axis in scans)):
        sets, variables = list(selection.sets), dict(selection.variables or {})
        pairs = list(zip((name for name, _ in scans), values, strict=True))
        for name, value in pairs:
            if name in declared:
                variables[name] = value
            else:
                sets.append(f"{name}={value}")
        suffix = f"[{','.join(f'{name}={value}' for name, value in pairs)}]" if pairs else ""
        yield SuiteEntry(replace(selection, sets=tuple(sets), variables=variables), suffix)
