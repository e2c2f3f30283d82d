"""Reports that are text, and that of the terminal, word for word.

After a wanted change: `make generated`, and read the difference.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from example_runs import BROKEN, USUAL

from golden import compare
from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.report.format_registry import renderer
from r2bspec.report.result_document import result_document
from r2bspec.report.terminal import to_text
from run_simulation import Simulation

SPEC = """\
r2bspec: 1
name: simulated
slos:
  camera:
    at: 30 Hz
    require:
      - latency.p99 < 60 ms
      - latency.p90 < 24 ms
      - drop_rate <= 0.5 %
  all:
    at: 30 Hz
    require: [latency.p50 < 60 ms]
"""

FORMATS = {
    "markdown": "md",
    "github": "txt",
    "junit": "xml",
}


EVERY_RUN = pytest.mark.parametrize(("name", "simulation"), [("usual", USUAL), ("broken", BROKEN)])


@EVERY_RUN
@pytest.mark.parametrize("format_name", FORMATS)
def test_the_report_reads_like_this(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    format_name: str,
    name: str,
    simulation: Simulation,
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = Path("simulated.r2b.yaml")
    spec.write_text(SPEC)
    run = simulation.write(tmp_path / "run")
    reported = ReportInput(result=result_of(run), run=run, spec_file=spec)
    file = Path(__file__).parent / f"{format_name}_{name}.{FORMATS[format_name]}"
    compare(renderer(format_name)(reported), file)


@EVERY_RUN
def test_the_terminal_reads_like_this(tmp_path: Path, name: str, simulation: Simulation) -> None:
    result = result_of(simulation.write(tmp_path))
    document = result_document(ReportInput(result=result))
    text = to_text(document, "runs/simulated-20260101-000000", 100)
    compare(text, Path(__file__).parent / f"terminal_{name}.txt")
    assert all(len(line) <= 100 for line in text.splitlines())
    assert "\x1b" not in text
