"""The states of a run, and how signals and the time budget end it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from r2bspec.execute.errors import InterruptedRunError
from r2bspec.execute.run_context import TimeBudget
from r2bspec.execute.states import Interrupts, RunState

PAGE = Path(__file__).parents[3] / "docs" / "running.md"


def test_the_page_names_every_state() -> None:
    phases = PAGE.read_text(encoding="utf-8").partition("## Phases")[2].partition("\n## ")[0]
    named = set(re.findall(r"[`*]+(\w+)[`*]+", phases))
    assert {str(state) for state in RunState} - {"prepare"} <= named


HOUR_NS = 3600 * 10**9


def test_what_fits_is_played_and_what_does_not_is_told() -> None:
    notes: list[str] = []
    budget = TimeBudget(HOUR_NS, notes.append)
    budget.begin()
    assert budget.allows("no more iterations", 60.0)
    assert not budget.allows("no confirmation run", 3601.0)
    assert notes == ["no confirmation run: it would exceed the time budget of 3600 s"]
    assert budget.left_out == ["No confirmation run: it would exceed the time budget of 3600 s."]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_is_reported_once(number: signal.Signals) -> None:
    with Interrupts() as interrupts:
        interrupts.check()
        os.kill(os.getpid(), number)
        with pytest.raises(InterruptedRunError, match=number.name) as raised:
            interrupts.check()
        assert raised.value.exit_code == 130
        # Cleaning up must not be interrupted by the signal that led to it.
        interrupts.check()


def test_a_signal_that_comes_as_long_work_begins_ends_it_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with Interrupts() as interrupts:
        check = interrupts.check

        def check_before_a_signal() -> None:
            monkeypatch.undo()
            check()
            os.kill(os.getpid(), signal.SIGTERM)

        monkeypatch.setattr(interrupts, "check", check_before_a_signal)
        with pytest.raises(InterruptedRunError), interrupts.immediate():
            pytest.fail("it began")


def test_what_catches_every_error_does_not_catch_an_interrupt() -> None:
    with (
        Interrupts() as interrupts,
        pytest.raises(InterruptedRunError, match="interrupted by SIGTERM"),
        interrupts.immediate(),
    ):
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(60)
        except Exception as error:
            raise ValueError("the bag cannot be read") from error


def test_a_run_that_was_started_with_nohup_outlives_its_terminal() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interrupts() as interrupts:
            os.kill(os.getpid(), signal.SIGHUP)
            interrupts.check()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_second_signal_ends_the_process_at_once() -> None:
    program = (
        "import os, signal; from r2bspec.execute import states as interrupts\n"
        "interrupts._DEBOUNCE_S = 0.0\n"
        "with interrupts.Interrupts():\n"
        "    os.kill(os.getpid(), signal.SIGTERM); print('one', flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGTERM); print('two', flush=True)\n"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout == "one\n"
    assert done.returncode == 130


def test_one_act_that_arrives_twice_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("r2bspec.execute.states._DEBOUNCE_S", 3600.0)
    with Interrupts() as interrupts:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(InterruptedRunError):
            interrupts.check()
