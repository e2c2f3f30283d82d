"""A pytest plugin: with ``--r2bspec``, every ``*.r2b.yaml`` that pytest finds is a file of tests.

The first test of a file validates the spec, as ``r2bspec validate`` does. Each requirement is a
test of its own; the first of them runs the benchmark for all. The cases of a matrix are parameters
of these tests. ``--r2bspec-runs DIR`` judges run folders ``DIR/NAME``, where NAME is the name of
the benchmark, instead of running, so that a machine without ROS can report what another one has
measured.

The benchmarks of a host run one at a time, in the order in which they came: a test waits while the
host runs others.

Without ``--r2bspec`` the plugin collects nothing and imports nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from r2bspec.judge.result import Result
    from r2bspec.judge.verdict import RequirementVerdict
    from r2bspec.language.load_spec import LoadedSpec

_SUFFIX = ".r2b.yaml"
_FLAGS = {
    "--r2bspec": f"collect *{_SUFFIX} as tests",
}
_VALUES = {
    "--r2bspec-runs": ("DIR", "judge the run folders DIR/NAME instead of running the benchmarks"),
    "--r2bspec-output": (
        "DIR",
        "write run folders to DIR/NAME, DIR/NAME-2 and so on  [default: runs/NAME-TIME]",
    ),
}


class BenchmarkError(Exception):
    """An error with a message that needs no traceback."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options, in a group of their own."""
    group = parser.getgroup("r2bspec", "benchmarks of ROS 2 graphs")
    for name, text in _FLAGS.items():
        group.addoption(name, action="store_true", help=text)
    for name, (metavar, text) in _VALUES.items():
        group.addoption(name, metavar=metavar, help=text)
    group.addoption(
        "--r2bspec-inconclusive",
        choices=["fail", "skip"],
        default="fail",
        help="the result of an inconclusive requirement  [default: fail]",
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect specs, with ``--r2bspec``."""
    if file_path.name.endswith(_SUFFIX) and parent.config.getoption("--r2bspec"):
        return _SpecFile.from_parent(parent, path=file_path)
    return None


class _SpecFile(pytest.File):
    """A spec; each case is loaded when it is collected, and run for its first requirement."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._results: dict[str, Result] = {}
        self._failures: dict[str, BenchmarkError] = {}

    def collect(self) -> Iterable[pytest.Item]:
        """One test of the spec itself, and one for each requirement; those of each case."""
        from r2bspec.diagnostics.quote import printable
        from r2bspec.language.load_spec import load_cases

        for loaded in load_cases(self.path):
            # As pytest writes the parameters of a test.
            case = printable(f"[{loaded.case}]") if loaded.case else ""
            yield _Validation.from_parent(self, name=f"valid{case}", loaded=loaded)
            if loaded.spec is None:
                continue
            for objective, slo in loaded.spec.slos.items():
                for number, requirement in enumerate(slo.require):
                    span = loaded.span(("slos", objective, "require", number))
                    yield _Requirement.from_parent(
                        self,
                        name=printable(f"{objective}: {requirement.text.strip()}") + case,
                        loaded=loaded,
                        objective=objective,
                        text=requirement.text,
                        line=span.line,
                    )

    def result(self, loaded: LoadedSpec) -> Result:
        """Return the judged run of a case, made once for all its tests.

        Raises:
            BenchmarkError: the run failed; every test of the case reports the same failure.
        """
        case = loaded.case
        if case in self._failures:
            raise self._failures[case]
        if case not in self._results:
            from r2bspec.errors import R2bspecError

            try:
                self._results[case] = self._run_or_judge(loaded)
            except R2bspecError as error:
                hint = f"\n{error.hint}" if error.hint else ""
                self._failures[case] = BenchmarkError(f"{error.code}: {error}{hint}")
                raise self._failures[case] from None
        return self._results[case]

    def _run_or_judge(self, loaded: LoadedSpec) -> Result:
        from r2bspec import api

        stored = self.config.getoption("--r2bspec-runs")
        if stored is not None:
            from r2bspec.compare.report_input import read_folder

            return read_folder(_stored_folder(Path(stored), loaded.id)).result
        output = self.config.getoption("--r2bspec-output")
        folder = _new_folder(Path(output) / api.folder_name(loaded.id)) if output else None
        prepared = api.prepare(self.path, case=loaded.case)
        return api.run(prepared, folder)


def _stored_folder(folder: Path, name: str) -> Path:
    """Return the run of a benchmark: of its name, or of its name as `r2bspec run` writes it."""
    from r2bspec.api import folder_name

    exact = folder / name
    return exact if exact.exists() else folder / folder_name(name)


def _new_folder(folder: Path) -> Path:
    """Return the folder, or the first of ``NAME-2``, ``NAME-3`` and so on that is not there."""
    number, place = 1, folder
    while place.exists():
        number += 1
        place = folder.with_name(f"{folder.name}-{number}")
    return place


class _SpecTest(pytest.Item):
    """A test of a spec, reported by its message instead of a traceback."""

    parent: _SpecFile

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        # Other plugins, such as pytest-lsp, expect of every test that it may have fixtures.
        self.funcargs: dict[str, object] = {}

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the message alone, for errors of the plugin itself."""
        if isinstance(excinfo.value, BenchmarkError):
            from r2bspec.diagnostics.plain_text import harmless

            return harmless(str(excinfo.value))
        return super().repr_failure(excinfo, style)


class _Validation(_SpecTest):
    """Whether the spec is valid, before anything runs."""

    def __init__(self, *, loaded: LoadedSpec, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._loaded = loaded

    def runtest(self) -> None:
        """Apply all rules; without a run, recorded data may be missing."""
        from r2bspec.check import check
        from r2bspec.report.findings_text import render_text

        offline = self.config.getoption("--r2bspec-runs") is not None
        findings = check(self._loaded, offline=offline)
        if any(finding.severity == "error" for finding in findings):
            raise BenchmarkError(render_text(findings, self._loaded.texts))

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return the first line of the spec."""
        return self.path, 0, f"{self.path.name}: valid"


class _Requirement(_SpecTest):
    """One requirement; for several monitors, of all of them."""

    def __init__(
        self, *, loaded: LoadedSpec, objective: str, text: str, line: int, **arguments: Any
    ) -> None:
        super().__init__(**arguments)
        self._loaded = loaded
        self._objective = objective
        self._text = text
        self._line = line

    def runtest(self) -> None:
        """Fail unless the requirement is met in a valid run."""
        from r2bspec.diagnostics.plain_text import harmless

        result = self.parent.result(self._loaded)
        if result.verdict.outcome in {"invalid", "incomplete"}:
            raise BenchmarkError(f"{result.verdict.outcome}: {result.verdict.reason}")
        verdicts = [
            requirement
            for requirement in result.verdict.requirements
            if (requirement.objective, requirement.text) == (self._objective, self._text)
        ]
        if not verdicts:
            raise BenchmarkError(
                "the run has no verdict on this requirement: it is from another version of the spec"
            )
        for verdict in verdicts:
            section = harmless("\n".join(_verdict_lines(verdict)))
            self.add_report_section("call", "verdict", section)
        self.add_report_section("call", "run", harmless(result.verdict.reason))
        counted = [run_verdict for run_verdict in verdicts if run_verdict.level == "error"]
        failed = [run_verdict for run_verdict in counted if run_verdict.outcome == "fail"]
        shown = failed or [
            run_verdict for run_verdict in counted if run_verdict.outcome == "inconclusive"
        ]
        if shown:
            explanation = "\n".join(
                line for run_verdict in shown for line in _verdict_lines(run_verdict)
            )
            if not failed and self.config.getoption("--r2bspec-inconclusive") == "skip":
                pytest.skip(harmless(explanation))
            raise BenchmarkError(explanation)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return the line of the requirement."""
        return self.path, self._line - 1, f"{self.path.name}: {self.name}"


def _verdict_lines(one: RequirementVerdict) -> Iterator[str]:
    from r2bspec.report.wording import bounds_text, estimate_text, sentences, verdict_word

    cells = (verdict_word(one), one.text.strip(), estimate_text(one), bounds_text(one))
    yield "  ".join(cells).strip()
    yield from (f"  {sentence}" for sentence in sentences(one))
