"""The input of a report: the result, and the run folder if there is one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from r2bspec.compare.errors import SamplesMissingError
from r2bspec.judge.result import Result
from r2bspec.measure.run_samples import read_samples
from r2bspec.measure.samples import RunSamples
from r2bspec.record.run_folder import Run


@dataclass(frozen=True)
class ReportInput:
    """A result, and what it was computed from.

    Attributes:
        result: shown by every report.
        run: the opened run folder, with plan and samples; None where only the result is known.
        spec_file: the spec whose objectives were judged, as the user named it, so that a report
            can refer to its lines; None where it is not known.
        baseline: another run, shown next to this one where a report supports it.
        monitor: the one monitor to report, for formats of a single one; None for all.
        rate_hz: the one offered rate to report, likewise.
        verbose: with every reason and every note; a report is short otherwise.
        suite_page: the HTML page of the suite that the run belongs to, if it has one.
        suite_link: the same, as a link of the page that is being written.
    """

    result: Result
    run: Run | None = None
    spec_file: Path | None = None
    baseline: Run | None = None
    monitor: str | None = None
    rate_hz: float | None = None
    verbose: bool = False
    suite_page: Path | None = None
    suite_link: str = ""

    def require_run(self, what: str) -> Run:
        """The run folder, for a format that needs it.

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
        return None if self.run is None else read_samples(self.run)

    @cached_property
    def baseline_samples(self) -> RunSamples | None:
        """The same of the baseline."""
        return None if self.baseline is None else read_samples(self.baseline)
