"""Processes of a run whose parents have ended count as the run's own."""

from __future__ import annotations

import os
import subprocess
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from family_trees import Family, family, wait_for
from r2bspec.execute.processes.resources import OrphanFinder, ResourceSampler
from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from r2bspec.judge.measure.host_usage import ORPHANS_INDEX

RUN = uuid.uuid4().hex

LEAVES_A_BUSY_CHILD = """
import subprocess, sys
child = subprocess.Popen([sys.executable, "-c", "while True: pass"], start_new_session={own})
print(child.pid, flush=True)
sys.stdin.read()
"""


@pytest.fixture
def people(tmp_path: Path) -> Iterator[Family]:
    with family(tmp_path, RUN) as found:
        yield found


def found_by(finder: OrphanFinder, leaders: dict[int, int]) -> dict[int, int]:
    return finder.find({}, leaders, ORPHANS_INDEX)


def test_an_orphan_belongs_to_the_process_whose_session_it_is_in(people: Family) -> None:
    (orphan,) = people.start("gone-of-worker")
    people.collect()
    leader = people.sessions[0].pid
    assert found_by(OrphanFinder(RUN), {leader: 3}) == {orphan: 3}


def test_of_one_with_a_session_of_its_own_only_the_run_is_known(people: Family) -> None:
    (orphan,) = people.start("gone-of-stranger")
    people.collect()
    assert found_by(OrphanFinder(RUN), {people.sessions[0].pid: 3}) == {orphan: ORPHANS_INDEX}


def test_one_that_was_seen_with_its_parent_is_remembered(people: Family) -> None:
    (orphan,) = people.start("gone-of-stranger")
    finder = OrphanFinder(RUN)
    assert finder.find({orphan: 5}, {}, ORPHANS_INDEX) == {}
    assert found_by(finder, {}) == {orphan: 5}


def test_other_runs_and_the_nameless_are_not_ours(people: Family) -> None:
    people.start("gone-of-nameless-worker")
    assert found_by(OrphanFinder(RUN), {}) == {}
    people.start("gone-of-worker")
    assert found_by(OrphanFinder(uuid.uuid4().hex), {}) == {}
    assert found_by(OrphanFinder(""), {}) == {}


@pytest.mark.parametrize("own", [False, True])
def test_what_an_orphan_uses_stays_with_its_process(own: bool) -> None:
    sampler = ResourceSampler(RUN)
    command = [sys.executable, "-c", LEAVES_A_BUSY_CHILD.format(own=own)]
    with subprocess.Popen(
        command,
        env=os.environ | {RUN_ID_VARIABLE: RUN},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    ) as parent:
        assert parent.stdin is not None
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        try:
            sampler.add(parent.pid)
            sampler.start()
            wait_for(lambda: used(sampler).size >= 3 and np.ptp(used(sampler)) > 0.3)
            parent.stdin.close()
            parent.wait()
            before = used(sampler)
            wait_for(lambda: used(sampler).size >= before.size + 5)
        finally:
            child.kill()
        sampler.stop()
    found = used(sampler)
    assert found[-1] > before[-1]
    # Ticks are of 10 ms. It is counted all the time, and once: it has one thread.
    assert np.all(np.diff(found) >= -0.02)
    assert np.ptp(found) <= np.ptp(times_ns(sampler)) / 1e9 + 0.2


def used(sampler: ResourceSampler) -> np.ndarray:
    rows = sampler.rows()
    return np.asarray(rows[rows["process"] == 0]["cpu_s"])


def times_ns(sampler: ResourceSampler) -> np.ndarray:
    rows = sampler.rows()
    return np.asarray(rows[rows["process"] == 0]["time_ns"])
