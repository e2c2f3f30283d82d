"""Commands of the spec that are not part of the graph: `setup` and `after_ready` steps."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from r2bspec.execute.errors import StepFailedError
from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.executables import resolve_command
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor, describe_exit
from r2bspec.plan.plan import SetupPlan
from r2bspec.private_files import user_umask
from r2bspec.record.run_folder import RunFolder

_POLL_S = 0.05


def run_setup_step(
    plan: SetupPlan,
    supervisor: ProcessSupervisor,
    environment: RunEnvironment,
    folder: RunFolder,
    base_dir: Path,
    note: Callable[[str], None],
) -> None:
    """Run a setup step, unless the file that it creates already exists.

    A lock makes concurrent runs with the same file wait for each other, so that one creates it.

    Raises:
        StepFailedError: it failed, exceeded its timeout, or did not create its file.
        NotInstalledError: its program is not installed.
    """
    created = base_dir / plan.creates if plan.creates else None
    with _locked(created):
        if created is not None and created.exists():
            note(f"{plan.name}: {plan.creates} already exists")
            return
        note(f"{plan.name}: {' '.join(plan.argv)}")
        child = supervisor.start(
            f"setup.{plan.name}",
            "command",
            environment.secrets.in_words(resolve_command(plan.argv, f"setup step {plan.name}")),
            environment.for_node(plan.env),
            cwd=base_dir / plan.directory,
            log=folder.log_path(f"setup.{plan.name}"),
            # What it makes is the user's, and stays.
            umask=user_umask(),
        )
        wait_for_exit(child, supervisor, plan.timeout_ns / 1e9)
        if created is not None and not created.exists():
            raise StepFailedError(
                f"setup step {plan.name} succeeded, but {plan.creates} does not exist",
                hint="Correct 'creates' of the step; paths are relative to the spec.",
            )


def wait_for_exit(child: ManagedProcess, supervisor: ProcessSupervisor, timeout_s: float) -> None:
    """Wait until a command exits with status 0.

    Raises:
        StepFailedError: it exited with another status, or ran longer than `timeout_s` seconds.
    """
    child.exit_expected = True
    deadline = time.monotonic() + timeout_s
    while child.process.poll() is None:
        if time.monotonic() > deadline:
            raise StepFailedError(
                f"{child.name} did not exit within {timeout_s:g} s",
                hint=f"Increase its timeout, or read its output in {child.log}",
            )
        supervisor.pump(_POLL_S)
    supervisor.end([child])
    if child.process.returncode:
        tail = child.log_tail()
        raise StepFailedError(
            f"{child.name} {describe_exit(child.process.returncode)}"
            + (f"; its last output:\n{tail}" if tail else "; it printed nothing"),
            hint=f"Its complete output is in {child.log}",
        )


@contextlib.contextmanager
def _locked(created: Path | None) -> Iterator[None]:
    """Hold the lock of the file that a step creates; no lock if it creates none."""
    if created is None:
        yield
        return
    from filelock import FileLock

    created.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(created.with_name(f".{created.name}.lock")):
        yield
