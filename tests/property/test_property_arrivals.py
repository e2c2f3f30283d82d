"""The native monitor converts times of arrival as `ClockOffsetTracker` does, steps included."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("rclpy")

import r2bspec.native
from r2bspec.ipc.clocks import ClockOffsetTracker
from r2bspec.native.build import build
from r2bspec.native.ros_headers import find_ros

NATIVE = Path(r2bspec.native.__file__).parent
SUPPORT = Path(__file__).parents[1] / "support"
BEGIN_NS = 10**12
EPOCH_NS = 1_700_000_000 * 10**9

PASSED = st.integers(0, 10**9)
STEPS = st.one_of(st.just(0), st.integers(-5_000_000, 5_000_000), st.integers(-(10**12), 10**12))
AGES = st.one_of(st.none(), st.integers(-(10**7), 10**10))


@pytest.fixture(scope="module")
def program() -> Path:
    return build(
        "clock_arrivals",
        [NATIVE / "timing.c", SUPPORT / "clock_arrivals.c"],
        find_ros(),
        kind="program",
        flags=(f"-I{NATIVE}",),
        libraries=(),
    )


@given(
    looks=st.lists(
        st.lists(st.tuples(PASSED, STEPS, AGES), min_size=1, max_size=12), min_size=20, max_size=20
    )
)
@settings(max_examples=12, deadline=None)
def test_arrivals_are_those_of_python(
    program: Path, looks: list[list[tuple[int, int, int | None]]]
) -> None:
    for each in looks:
        now = [BEGIN_NS, EPOCH_NS]
        lines, expected = [], []
        tracker: ClockOffsetTracker | None = None
        for passed_ns, step_ns, age_ns in each:
            now[0] += passed_ns
            now[1] = max(1, now[1] + passed_ns + step_ns)
            tracker = tracker or ClockOffsetTracker(lambda: now[0], lambda: now[1])  # noqa: B023
            arrived_ns = 0 if age_ns is None else max(0, now[1] - age_ns)
            lines.append(f"{now[0]} {now[1]} {arrived_ns}")
            expected.append(" ".join(map(str, tracker.arrival(arrived_ns))))
        done = subprocess.run(
            [program], input="\n".join(lines), stdout=subprocess.PIPE, text=True, check=True
        )
        assert done.stdout.splitlines() == expected
