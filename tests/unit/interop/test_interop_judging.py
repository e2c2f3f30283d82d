"""Reports of the reference tool under a spec's objectives: judged only by what they can show."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from command_line import Call
from r2bspec.cli.main import main
from r2bspec.interop.imported_verdicts import judge_report
from r2bspec.interop.ros2_benchmark import parse_report
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.comparison_grammar import parse_requirement
from r2bspec.language.quantities import Rate
from r2bspec.language.spec import Objective


def figures(**values: float) -> dict[str, float]:
    return {f"BasicPerformanceMetrics.{key}": value for key, value in values.items()}


REPORT: dict[str, Any] = {
    **figures(NUM_FRAMES_SENT=650, NUM_MISSED_FRAMES=14),
    "30.0fps": figures(
        RECEIVED_DURATION=5000.0,
        MEAN_FRAME_RATE=30.0,
        NUM_FRAMES_SENT=150,
        NUM_MISSED_FRAMES=0,
        MEAN_LATENCY=9.0,
        MAX_LATENCY=12.0,
        MIN_LATENCY=7.0,
    ),
    "metadata": {"BenchmarkMetadata.PEAK_THROUGHPUT_PREDICTION": 130.0},
}


def judged(
    requirement: str, at: str | None = "30 Hz", report: dict[str, Any] = REPORT
) -> list[RequirementVerdict]:
    objective = Objective(
        at=Rate.parse(at) if at else None, require=(parse_requirement(requirement),)
    )
    verdict = judge_report(parse_report(json.dumps(report).encode()), {"it": objective})
    return list(verdict.requirements)


@pytest.mark.parametrize(
    ("requirement", "at", "outcome"),
    [
        ("latency.mean < 10 ms", "30 Hz", "pass"),
        ("latency.mean < 8 ms", "30 Hz", "fail"),
        ("throughput.mean >= 99 % of offered", "30 Hz", "pass"),
        ("throughput.mean >= 31 Hz", "30 Hz", "fail"),
        # The only monitor of a report answers for whatever the spec calls it.
        ("detections.latency.mean < 10 ms", "30 Hz", "pass"),
        # The iteration that did worst was dropped: a limit can be seen broken, never kept.
        ("latency.max < 11 ms", "30 Hz", "fail"),
        ("latency.max < 20 ms", "30 Hz", "inconclusive"),
        ("latency.min >= 8 ms", "30 Hz", "fail"),
        ("latency.min >= 6 ms", "30 Hz", "inconclusive"),
        ("missed == 0", "30 Hz", "inconclusive"),
        # 0 of 150: at most 1.98 % at 95 % confidence.
        ("drop_rate <= 2 %", "30 Hz", "pass"),
        ("drop_rate <= 1.9 %", "30 Hz", "inconclusive"),
        # Its search errs upwards.
        ("peak.rate >= 140 Hz", None, "fail"),
        ("peak.rate >= 120 Hz", None, "inconclusive"),
        ("peak.rate <= 140 Hz", None, "pass"),
        # Nothing is known of these.
        ("latency.p99 < 1 s", "30 Hz", "inconclusive"),
        ("latency.max < 20 ms in 99 % of 1 s windows", "30 Hz", "inconclusive"),
        ("sustained", "30 Hz", "inconclusive"),
        ("cpu.system.mean < 90 %", "30 Hz", "inconclusive"),
        ("throughput.mean >= 97 % of baseline", "30 Hz", "inconclusive"),
        ("latency.mean < 10 ms", "60 Hz", "inconclusive"),
    ],
)
def test_a_report_is_asked_only_for_what_it_can_show(
    requirement: str, at: str | None, outcome: str
) -> None:
    (found,) = judged(requirement, at)
    assert found.outcome == outcome, found.reason
    assert found.reason
    assert bool(found.remedy) == (outcome == "inconclusive")


def test_with_several_monitors_each_gets_a_verdict_and_a_name_must_be_theirs() -> None:
    one, other = figures(MEAN_LATENCY=9.0), figures(MEAN_LATENCY=19.0)
    report = {"30.0fps": {"left": one, "right": other}, **figures(NUM_FRAMES_SENT=1)}
    found = judged("latency.mean < 10 ms", report=report)
    assert [(each.monitor, each.outcome) for each in found] == [("left", "pass"), ("right", "fail")]
    for name, outcome in (("right", "fail"), ("middle", "inconclusive")):
        (named,) = judged(f"{name}.latency.mean < 10 ms", report=report)
        assert named.outcome == outcome


def test_judge_takes_a_report_and_exits_as_with_a_run(
    tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    report = tmp_path / "report.json"
    report.write_text(json.dumps(REPORT))
    asked = ["judge", str(report), "--spec", "specs/relay.r2b.yaml"]
    assert main([*asked, "--format", "json"]) == 3
    verdict = json.loads(capfdbinary.readouterr().out)
    assert verdict["exit_code"] == 3
    assert "peak.rate >= 90 Hz" in {each["text"] for each in verdict["requirements"]}
    assert main(asked) == 3
    assert b"INCONCLUSIVE" in capfdbinary.readouterr().out


def test_a_report_needs_a_spec_and_has_no_samples_to_report(tmp_path: Path, call: Call) -> None:
    report = tmp_path / "report.json"
    report.write_text(json.dumps(REPORT))
    assert "--spec" in call("judge", report, status=2).err
    ended = call("judge", report, "--spec", "specs/relay.r2b.yaml", "--write", status=2)
    assert "run folder" in ended.err
