"""Limits of the user and the machine with which no run can start, and those that may end one."""

from __future__ import annotations

import re
import resource
import subprocess
import sys

import pytest

from r2bspec.execute.errors import AddressSpaceError
from r2bspec.execute.processes.prerequisites import (
    limit_error,
    require_address_space,
    require_loopback,
    with_limits,
)


def limit(monkeypatch: pytest.MonkeyPatch, which: int, soft: int) -> None:
    limits = {which: soft}
    read = lambda number: (limits.get(number, resource.RLIM_INFINITY),) * 2  # noqa: E731
    monkeypatch.setattr(resource, "getrlimit", read)


def test_an_address_space_in_which_nothing_starts_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    limit(monkeypatch, resource.RLIMIT_AS, 400 << 20)
    text = "the address space of a process is limited to 400 MiB (ulimit -v)"
    with pytest.raises(AddressSpaceError, match=re.escape(text)) as caught:
        require_address_space()
    assert caught.value.exit_code == 2
    # More may do: it depends on the graph.
    limit(monkeypatch, resource.RLIMIT_AS, 4 << 30)
    require_address_space()


@pytest.mark.parametrize(
    ("which", "text"),
    [
        (resource.RLIMIT_AS, "the address space of a process is limited to 2 GiB (ulimit -v)"),
        (resource.RLIMIT_FSIZE, "the size of a file is limited to 2 GiB (ulimit -f)"),
        (resource.RLIMIT_CORE, ""),
    ],
)
def test_what_may_have_ended_a_process_is_said_with_its_end(
    monkeypatch: pytest.MonkeyPatch, which: int, text: str
) -> None:
    limit(monkeypatch, which, 2 << 30)
    said = f"See the log. A limit may be the cause: {text}." if text else "See the log."
    assert with_limits("See the log.") == said


@pytest.mark.parametrize(
    "text",
    [
        "RuntimeError: can't start new thread",
        "BlockingIOError: [Errno 11] Resource temporarily unavailable",
        "cc: fatal error: vfork: Resource temporarily unavailable",
        "pthread_create failed: Resource temporarily unavailable",
    ],
)
def test_what_no_process_or_thread_can_be_started_for_is_said(
    monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    """Threads need address space, too; a control group says nothing of its limit."""
    for which, code, reason in (
        (resource.RLIMIT_NPROC, "R2B679", "is limited to 20 (ulimit -u)"),
        (resource.RLIMIT_CORE, "R2B679", "the control group of this process is full"),
        (resource.RLIMIT_AS, "R2B678", "is limited to 20 B (ulimit -v)"),
    ):
        limit(monkeypatch, which, 20)
        error = limit_error(text)
        assert error is not None
        assert (error.code, error.exit_code) == (code, 2)
        assert f"{reason}; {text}" in str(error)
        assert error.hint
    assert limit_error("the socket: Resource temporarily unavailable") is None


def test_a_machine_without_loopback_is_named_before_anything_starts() -> None:
    require_loopback()
    program = (
        "from r2bspec.execute.processes.prerequisites import *\n"
        "try:\n    require_loopback()\nexcept errors.NoLoopbackError as error: print(error.code)"
    )
    isolated = ["unshare", "--user", "--map-root-user", "--net"]
    done = subprocess.run(
        [*isolated, sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    if "unshare" in done.stderr:
        pytest.skip(f"no network namespace can be made here: {done.stderr.strip()}")
    assert done.stdout.split() == ["R2B699"]
