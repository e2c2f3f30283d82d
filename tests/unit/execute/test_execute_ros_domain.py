"""Promise: two runs on one machine never share a ROS domain."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys

import pytest

from r2bspec.execute.errors import RunError
from r2bspec.execute.processes import prerequisites
from r2bspec.execute.processes.prerequisites import reserved_domain


@pytest.fixture
def few_domains(monkeypatch: pytest.MonkeyPatch) -> range:
    """Only a few domains, far from those that other programs use."""
    # Ports of their own, so that what else runs on this machine does not matter.
    monkeypatch.setattr(prerequisites, "_PORT_BASE", 21_000 + os.getpid() % 5_000)
    monkeypatch.setattr(prerequisites, "_MIN_DOMAIN", 1)
    monkeypatch.setattr(prerequisites, "_MAX_DOMAIN", 4)
    return range(1, 5)


def test_reservations_differ_and_are_free_afterwards(few_domains: range) -> None:
    for _ in range(3):
        with contextlib.ExitStack() as stack:
            taken = [stack.enter_context(reserved_domain()) for _ in few_domains]
            assert sorted(taken) == list(few_domains)


def test_when_all_are_taken_it_says_so(few_domains: range) -> None:
    with contextlib.ExitStack() as stack:
        for _ in few_domains:
            stack.enter_context(reserved_domain())
        with pytest.raises(RunError, match="all ROS domains from 1 to 4 are in use"):
            stack.enter_context(reserved_domain())


def test_a_reservation_ends_with_its_process_however_it_ends(few_domains: range) -> None:
    program = (
        "import sys, time; from r2bspec.execute.processes import prerequisites; "
        "prerequisites._PORT_BASE, prerequisites._MIN_DOMAIN, prerequisites._MAX_DOMAIN = "
        "map(int, sys.argv[1:]); "
        "held = prerequisites.reserved_domain(); "
        "print(held.__enter__(), flush=True); time.sleep(600)"
    )
    with contextlib.ExitStack() as stack:
        taken = [stack.enter_context(reserved_domain()) for _ in range(3)]
        with subprocess.Popen(
            [sys.executable, "-c", program, str(prerequisites._PORT_BASE), "1", "4"],
            stdout=subprocess.PIPE,
        ) as process:
            assert process.stdout is not None
            theirs = int(process.stdout.readline())
            assert {theirs, *taken} == set(few_domains)
            with pytest.raises(RunError):
                stack.enter_context(reserved_domain())
            os.kill(process.pid, signal.SIGKILL)
        assert stack.enter_context(reserved_domain()) == theirs


def test_a_child_process_does_not_prolong_a_reservation(few_domains: range) -> None:
    with contextlib.ExitStack() as stack:
        for _ in few_domains:
            stack.enter_context(reserved_domain())
        process = subprocess.Popen(
            [sys.executable, "-c", "import sys; sys.stdin.read()"],
            stdin=subprocess.PIPE,
        )
    try:
        with contextlib.ExitStack() as stack:
            for _ in few_domains:
                stack.enter_context(reserved_domain())
    finally:
        process.communicate()


def test_the_ports_of_every_domain_stay_clear_of_the_ephemeral_range() -> None:
    # OMG DDSI-RTPS 2.5, section 9.6.2.3: PB + DG x domain, and at most 250 ports from there.
    assert 7400 + 250 * (prerequisites._MAX_DOMAIN + 1) <= 32768
    assert prerequisites._MIN_DOMAIN >= 1
