"""GPUs by a libnvidia-ml.so.1 that is compiled here, and processor packages of a made-up /sys."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from r2bspec.execute.processes.devices import PackageEnergy
from r2bspec.judge.measure.host_usage import MACHINE_INDEX, DeviceUse, ProcessSamples, device_use
from r2bspec.record.sample_arrays import DEVICE_DTYPE, Rows

STUB = Path(__file__).parents[2] / "support" / "stub_nvml.c"
PID, PROCESS = 42, 7

SAMPLES = f"""
import json, os, sys, time
from r2bspec.execute.processes.devices import DeviceReader, describe_devices
reader, rows = DeviceReader(), b""
for number in range(6):
    if number == 4 and "LOSE" in os.environ:
        os.environ["LOST"] = "yes"
    rows += b"".join(reader.rows({{{PID}: {PROCESS}}}))
    time.sleep(0.06)
print(json.dumps([describe_devices(), rows.hex()]))
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("nvml") / "libnvidia-ml.so.1"
    subprocess.run(["cc", "-shared", "-fPIC", "-w", "-o", file, STUB], check=True)  # noqa: S607
    return file.parent


def sampled(library: Path | None, **devices: str) -> tuple[dict[str, Any], Rows]:
    environment = os.environ | {"PID": str(PID)} | devices
    environment["LD_LIBRARY_PATH"] = str(library or "")
    output = subprocess.run(
        [sys.executable, "-c", SAMPLES], env=environment, capture_output=True, check=True, text=True
    ).stdout
    facts, rows = json.loads(output)
    return facts, np.frombuffer(bytes.fromhex(rows), DEVICE_DTYPE)


def used(rows: Rows, first: int = 0, last: int = -1) -> dict[int, DeviceUse]:
    """What devices did between two samples, in which 10 steps were played."""
    times = rows[rows["process"] == MACHINE_INDEX]["time_ns"]
    if not times.size:
        return {}
    return device_use(ProcessSamples(rows), int(times[first]), int(times[last]), 10)


def test_a_gpu_is_measured_for_the_machine_and_for_its_process(library: Path) -> None:
    facts, rows = sampled(library, GPUS="1")
    assert (facts["gpus"], facts["gpu_unmeasured"]) == (["Stub"], "")
    machine, process = used(rows)[MACHINE_INDEX], used(rows)[PROCESS]
    # Without a counter of energy, the power counts; what has no encoder has no value of it.
    expected = {"busy_s": 0.4, "decoder_s": 0.1, "gpu_j": 250.0}
    assert machine.mean == pytest.approx(expected)
    assert machine.most == pytest.approx(expected)
    assert machine.gpu_bytes == 2**30
    assert process.mean == pytest.approx({"busy_s": 0.3, "encoder_s": 0.0, "decoder_s": 0.0})
    assert process.gpu_bytes == 2**20


def test_two_gpus_are_added_up(library: Path) -> None:
    facts, rows = sampled(library, GPUS="2")
    machine, process = used(rows)[MACHINE_INDEX], used(rows)[PROCESS]
    assert facts["gpus"] == ["Stub", "Stub"]
    assert machine.mean["busy_s"] == pytest.approx(0.8)
    assert machine.gpu_bytes == 2 * 2**30
    assert process.mean["busy_s"] == pytest.approx(0.3)
    assert process.gpu_bytes == 2 * 2**20
    times = rows["time_ns"][[0, -2]]
    # The second one counts energy: 50 J from sample to sample.
    joules = 250.0 * np.diff(times).item() / 1e9 + 5 * 50.0
    assert machine.per_step["gpu_j"] == pytest.approx(joules / 10)


def test_what_a_gpu_did_is_unknown_once_it_is_lost_and_known_before(library: Path) -> None:
    _, rows = sampled(library, GPUS="2", LOSE="yes")
    before, after = used(rows, 0, 2), used(rows, 3, -1)
    assert before[MACHINE_INDEX].mean["busy_s"] == pytest.approx(0.8)
    for index in (MACHINE_INDEX, PROCESS):
        assert after[index] == DeviceUse({}, {}, {}, None)


@pytest.mark.parametrize(
    ("devices", "why"),
    [
        ({"GPUS": "1", "DENIED": "yes"}, "NVML says: Insufficient Permissions"),
        ({"GPUS": "0"}, "NVML knows no GPU"),
        (None, "NVML says: NVML Shared Library Not Found"),
    ],
)
def test_without_a_gpu_it_is_said_why_nothing_is_measured(
    library: Path, devices: dict[str, str] | None, why: str
) -> None:
    facts, rows = sampled(library if devices is not None else None, **devices or {})
    assert (facts["gpus"], facts["gpu_unmeasured"]) == ([], why)
    assert not any("gpu_j" in one.mean for one in used(rows).values())


def zone(root: Path, name: str, label: str, energy_uj: int, wraps_at: int = 1_000_000_000) -> Path:
    folder = root / "sys/class/powercap" / name
    folder.mkdir(parents=True)
    (folder / "name").write_text(f"{label}\n")
    (folder / "max_energy_range_uj").write_text(f"{wraps_at}\n")
    (folder / "energy_uj").write_text(f"{energy_uj}\n")
    return folder / "energy_uj"


def test_the_energy_of_packages_is_counted_once_and_beyond_the_end_of_the_counter(
    tmp_path: Path,
) -> None:
    made = partial(zone, tmp_path)
    first, second = (
        made("intel-rapl:0", "package-0", 999_000_000),
        made("intel-rapl:1", "package-1", 5),
    )
    made("intel-rapl:0:0", "core", 77)
    made("intel-rapl-mmio:0", "package-0", 88)
    made("intel-rapl:2", "psys", 99)
    energy = PackageEnergy(tmp_path)
    assert (energy.read(), energy.why_not) == (0.0, "")
    first.write_text("1000000\n")
    second.write_text("3000005\n")
    assert energy.read() == pytest.approx(2.0 + 3.0)


def test_energy_that_cannot_be_read_is_unknown(tmp_path: Path) -> None:
    assert "no counter" in PackageEnergy(tmp_path).why_not
    counter = zone(tmp_path, "intel-rapl:0", "package-0", 1)
    counter.unlink()
    counter.mkdir()
    energy = PackageEnergy(tmp_path)
    assert energy.why_not == f"{counter} cannot be read by this user"
    assert math.isnan(energy.read())
