"""What the kernel counts of the machine around a run."""

from __future__ import annotations

import math
import time
from pathlib import Path

import pytest

from r2bspec.execute.processes.resources import InterferenceReader

PRESSURE = "some avg10=1.25 avg60=0.90 avg300=0.35 total=2500000\nfull avg10=0.00 total=7\n"


def write(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def test_this_machine() -> None:
    reader = InterferenceReader()
    first = reader.read()
    end = time.process_time() + 0.1
    while time.process_time() < end:
        pass
    second = reader.read()
    assert second.busy_s > first.busy_s
    for before, after in zip(first, second, strict=True):
        assert math.isnan(before) == math.isnan(after)
        assert math.isnan(before) or after >= before


def test_what_a_system_does_not_tell_is_unknown(tmp_path: Path) -> None:
    found = InterferenceReader(tmp_path).read()
    assert math.isnan(found.waited_s)
    assert math.isnan(found.throttled_s)


def test_what_nobody_can_read_is_unknown(tmp_path: Path) -> None:
    root = write(tmp_path, {"proc/pressure/cpu": "some words\n"})
    assert math.isnan(InterferenceReader(root).read().waited_s)


@pytest.mark.parametrize(
    ("files", "waited_s", "throttled_s"),
    [
        ({"proc/pressure/cpu": PRESSURE}, 2.5, None),
        # Version 2: the group's own pressure, and the quota of any group above.
        (
            {
                "proc/pressure/cpu": PRESSURE,
                "proc/self/cgroup": "0::/slice/one\n",
                "sys/fs/cgroup/slice/one/cpu.pressure": PRESSURE.replace("2500000", "1000000"),
                "sys/fs/cgroup/slice/one/cpu.stat": "usage_usec 5\nthrottled_usec 0\n",
                "sys/fs/cgroup/slice/cpu.stat": "usage_usec 9\nthrottled_usec 300000\n",
            },
            1.0,
            0.3,
        ),
        # Version 1.
        (
            {
                "proc/self/cgroup": "4:memory:/a\n2:cpu,cpuacct:/a\n",
                "sys/fs/cgroup/cpu,cpuacct/a/cpu.stat": "nr_throttled 2\nthrottled_time 2000000\n",
            },
            None,
            0.002,
        ),
        # In a container, whose path begins outside of what it can see.
        (
            {
                "proc/self/cgroup": "0::/../../elsewhere\n",
                "sys/fs/cgroup/cpu.stat": "throttled_usec 4000\n",
            },
            None,
            0.004,
        ),
        # Cores get hot at once.
        (
            {
                f"sys/devices/system/cpu/{core}/thermal_throttle/core_throttle_total_time_ms": "5"
                for core in ("cpu0", "cpu1")
            },
            None,
            0.005,
        ),
    ],
)
def test_where_it_is_read(
    tmp_path: Path, files: dict[str, str], waited_s: float | None, throttled_s: float | None
) -> None:
    found = InterferenceReader(write(tmp_path, files)).read()
    assert found.waited_s == waited_s or (waited_s is None and math.isnan(found.waited_s))
    assert found.throttled_s == throttled_s or (
        throttled_s is None and math.isnan(found.throttled_s)
    )
