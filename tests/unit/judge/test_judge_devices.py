"""Requirements on GPUs and on the energy of processors, in verdicts, tables, pages and formats."""

from __future__ import annotations

from pathlib import Path

import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.measure.units import show
from r2bspec.judge.pipeline import judge
from r2bspec.report.result_table import result_rows
from r2bspec.report.terminal import render
from run_simulation import Played, Simulation, objective

DEVICES = {"busy_s": 0.6, "encoder_s": 0.2, "gpu_j": 120.0, "package_j": 30.0, "gpu_bytes": 2**30}
VALUES = {
    "gpu.utilization.mean <= 70 %": "60 %",
    "gpu.utilization.apriltag.max <= 40 %": "30 %",
    "gpu.encoder.mean <= 10 %": "20 %",
    "gpu.memory.max <= 2 GiB": "1 GiB",
    "gpu.memory.apriltag.max <= 2 GiB": "512 MiB",
    "gpu.power.mean <= 150 W": "120 W",
    "gpu.power.max < 100 W": "120 W",
    "power.package.mean <= 0.04 kW": "30 W",
    "energy.gpu <= 5 J": "4 J",
    "energy.package <= 500 mJ": "1 J",
}
"""Requirements at 30 Hz, and the value of each."""

FAILED = {"gpu.encoder.mean <= 10 %", "gpu.power.max < 100 W", "energy.package <= 500 mJ"}


def simulation(*requirements: str, **fields: object) -> Simulation:
    played = [Played(30.0, [0.01] * 60) for _ in range(3)]
    objectives = {"devices": objective(*requirements)}
    return Simulation(played, objectives, **fields)  # type: ignore[arg-type]


def test_requirements_on_devices_are_judged_and_reported(tmp_path: Path) -> None:
    run = simulation(*VALUES, devices=DEVICES).write(tmp_path / "run")
    result = result_of(run)
    verdicts = {one.text: one for one in result.verdict.requirements}
    assert {name: show(one.estimate, one.unit) for name, one in verdicts.items()} == VALUES
    assert {name for name, one in verdicts.items() if one.outcome == "fail"} == FAILED
    assert {one.outcome for one in verdicts.values()} == {"pass", "fail"}
    rows = {row.metric: show(row.value, row.unit) for row in result_rows(result)}
    assert rows["power.package.mean"] == "30 W"
    assert rows["gpu.utilization.apriltag.mean"] == "30 %"
    assert "gpu.decoder.mean" not in rows
    assert "energy.gpu" in render(ReportInput(result)).decode().partition("devices")[2]


@pytest.mark.parametrize(
    ("requirement", "devices", "why"),
    [
        ("gpu.power.mean <= 9 W", {}, "NVML knows no GPU"),
        ("gpu.memory.max <= 9 B", {}, "NVML knows no GPU"),
        ("energy.package <= 9 J", {}, "no counter"),
        ("gpu.decoder.max <= 9 %", {"busy_s": 1.0}, "the machine did not report it all the time"),
    ],
)
def test_what_is_not_measured_is_open_and_says_why(
    requirement: str, devices: dict[str, float], why: str
) -> None:
    facts = {"gpu_unmeasured": "NVML knows no GPU", "package_unmeasured": "no counter"}
    machine = {} if devices else facts
    samples = simulation(requirement, devices=devices, machine=machine)
    (verdict,) = judge(samples.objectives, samples.samples()).requirements
    assert verdict.outcome == "inconclusive"
    assert verdict.reason == f"{requirement.split()[0]} was not measured: {why}."
