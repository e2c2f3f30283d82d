"""The terminal report, word for word.

After a wanted change: `make generated`, and read the difference.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from example_runs import BROKEN, USUAL

from golden import compare
from r2bspec.judge.judge_run import result_of
from r2bspec.report.terminal import to_text
from run_simulation import Simulation


@pytest.mark.parametrize("width", [80, 100, 120])
@pytest.mark.parametrize(("name", "simulation"), [("usual", USUAL), ("broken", BROKEN)])
def test_the_report_reads_like_this(
    tmp_path: Path, name: str, simulation: Simulation, width: int
) -> None:
    result = result_of(simulation.write(tmp_path))
    text = to_text(result, Path("runs/simulated-20260101-000000"), width)
    compare(text, Path(__file__).parent / f"terminal_{name}_{width}.txt")
    assert all(len(line) <= width for line in text.splitlines())
    assert "\x1b" not in text
