"""The first signal asks for an end, the second enforces it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from r2bspec.execute.errors import InterruptedRunError
from r2bspec.execute.states import Interrupts

SIGNALS = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])


@SIGNALS
def test_a_signal_is_reported_once(number: signal.Signals) -> None:
    with Interrupts() as interrupts:
        interrupts.check()
        os.kill(os.getpid(), number)
        with pytest.raises(InterruptedRunError, match=number.name) as raised:
            interrupts.check()
        assert raised.value.exit_code == 130
        # Cleaning up must not be interrupted by the signal that led to it.
        interrupts.check()


def test_a_signal_that_came_before_long_work_keeps_it_from_beginning() -> None:
    with Interrupts() as interrupts:
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(InterruptedRunError), interrupts.immediate():
            pytest.fail("it began")


def test_after_long_work_signals_wait_again() -> None:
    with Interrupts() as interrupts:
        with interrupts.immediate():
            pass
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(InterruptedRunError):
            interrupts.check()


def test_handlers_are_as_before_afterwards() -> None:
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    with Interrupts():
        assert signal.getsignal(signal.SIGINT) != before[signal.SIGINT]
    assert {each: signal.getsignal(each) for each in before} == before


@SIGNALS
def test_what_catches_every_error_does_not_catch_an_interrupt(number: signal.Signals) -> None:
    with (
        Interrupts() as interrupts,
        pytest.raises(InterruptedRunError, match=f"interrupted by {number.name}"),
        interrupts.immediate(),
    ):
        try:
            os.kill(os.getpid(), number)
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


@SIGNALS
def test_a_second_signal_ends_the_process_at_once(number: signal.Signals) -> None:
    program = (
        "import os, sys; from r2bspec.execute import states as interrupts\n"
        "interrupts._DEBOUNCE_S = 0.0\n"
        "with interrupts.Interrupts():\n"
        "    os.kill(os.getpid(), int(sys.argv[1])); print('one', flush=True)\n"
        "    os.kill(os.getpid(), int(sys.argv[1])); print('two', flush=True)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(int(number))],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "one\n"
    assert done.returncode == 130


def test_one_act_that_arrives_twice_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("r2bspec.execute.states._DEBOUNCE_S", 3600.0)
    with Interrupts() as interrupts:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(InterruptedRunError):
            interrupts.check()


def test_a_run_in_a_thread_does_without_signals() -> None:
    # Python lets only the main thread set handlers; whoever runs us elsewhere has their own.
    problems: list[BaseException] = []

    def run() -> None:
        try:
            with Interrupts() as interrupts:
                interrupts.check()
        except BaseException as error:
            problems.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert problems == []
