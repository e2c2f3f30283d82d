"""One more iteration, profiled or observed from inside, whose cost does not reach the results.

It is played after everything that counts, including the confirmation of a failure. Processes that
are observed from inside (`r2bspec.execute.anatomy`) are started afresh, and so are those whose
command a profiler prefixes. A failure of this iteration is recorded, and does not change the
verdict.

``perf``, ``py-spy`` and ``nsys`` stand for such words. Whether the system permits perf or py-spy to
observe a process is tried before anything is measured: it depends on settings of the system, on the
container, and on the kernel for which perf was built.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec

from r2bspec.diagnostics.quote import clip, printable
from r2bspec.errors import R2bspecError, UsageError, without_output
from r2bspec.execute.errors import CertainRunError, InterruptedRunError
from r2bspec.execute.run_context import MEASURE_PHASE
from r2bspec.execute.start.segments import SegmentHeading, SegmentPlayer, titled
from r2bspec.extras import install_command
from r2bspec.language.quantities import Duration
from r2bspec.plan.plan import GRAPH_ROLES, Plan, ProcessPlan
from r2bspec.record.run_record import AnatomyRecord, ProfileRecord
from r2bspec.safe_io.file_search import regular_files
from r2bspec.safe_io.private_files import temporary_folder

if TYPE_CHECKING:
    from r2bspec.execute.start.start import StartSequence

OUTPUT: Final = "$(profile)"
"""In the words: the path, without a suffix, of the file that the profiler should write."""

# 199 samples a second: a prime does not keep step with a node that works at a round rate.
_WORDS: Final = {
    "perf": "perf record --quiet -F 199 --call-graph dwarf --max-size 512M "
    f"-o {OUTPUT}.perf.data --",
    "py-spy": f"py-spy record --rate 199 --subprocesses --output {OUTPUT}.svg --",
    "nsys": f"nsys profile --trace=cuda,nvtx,osrt --force-overwrite=true --output {OUTPUT}",
}
_INSTALL: Final = {
    "perf": "Install it (Debian: apt install linux-perf; Ubuntu: apt install linux-tools-generic), "
    "or use '--profile py-spy' for Python nodes.",
    "py-spy": install_command("profile"),
    "nsys": "Install NVIDIA Nsight Systems, and see that its folder is in PATH.",
}
_PERMIT: Final = {
    "perf": "Allow it with 'sudo sysctl kernel.perf_event_paranoid=1'; in a container, start that "
    "with --cap-add PERFMON and a seccomp profile that allows perf_event_open.",
    "py-spy": "In a container, start that with --cap-add SYS_PTRACE.",
}
# A profiler leaves out what sleeps: the trial has to compute.
_TRIAL: Final = "import time; end = time.time() + 0.5\nwhile time.time() < end: pass"
_TRIAL_TIMEOUT_S: Final = 20.0
_SHOWN_LINES: Final = 4
_UNUSABLE: Final = "R2B652"


@dataclass(frozen=True)
class Profiler:
    """A profiler, and how a run uses it.

    Attributes:
        name: ``perf``, ``py-spy``, ``nsys``, or the first word of the command.
        words: before the command of the process to be observed.
    """

    name: str
    words: tuple[str, ...]

    def prefix(self, base: Path) -> tuple[str, ...]:
        """Return the words before a command; `base` is the file to write, without suffix."""
        return tuple(word.replace(OUTPUT, str(base)) for word in self.words)


def find_profiler(text: str) -> Profiler:
    """Return the profiler that a user names: ``perf``, ``py-spy``, ``nsys``, or words of a command.

    Raises:
        UsageError: the text has no words, or cannot be split into words.
    """
    try:
        words = shlex.split(_WORDS.get(text.strip(), text))
    except ValueError as error:
        raise UsageError(
            f"--profile {text!r} cannot be split into words: {error}",
            hint="Quote the words as for a shell.",
        ) from error
    if not words:
        raise UsageError(
            "--profile needs perf, py-spy, nsys, or the words of a command",
            hint="For example --profile perf.",
        )
    # What was installed with this interpreter is found even if its environment is not activated.
    own = os.fspath(Path(sys.executable).parent)
    program = shutil.which(words[0]) or shutil.which(words[0], path=own) or words[0]
    return Profiler(Path(words[0]).name, (program, *words[1:]))


def require_usable(profiler: Profiler) -> None:
    """Check that a profiler is installed and, for perf and py-spy, may observe a process.

    Raises:
        CertainRunError: it is not, or may not (R2B652).
    """
    program = profiler.words[0]
    if "/" not in program or not Path(program).exists():
        raise CertainRunError(
            f"--profile: the program {program!r} is not installed",
            hint=_INSTALL.get(profiler.name, "Install it, or give its full path."),
            code=_UNUSABLE,
        )
    if profiler.name not in _PERMIT:
        return
    with temporary_folder("profile") as folder:
        try:
            done = subprocess.run(
                [*profiler.prefix(folder / "trial"), sys.executable, "-S", "-c", _TRIAL],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=_TRIAL_TIMEOUT_S,
                errors="replace",
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise CertainRunError(
                f"--profile: {profiler.name} cannot be run: {error}",
                hint=_PERMIT[profiler.name],
                code=_UNUSABLE,
            ) from error
    if done.returncode:
        said = [line for line in done.stdout.splitlines() if line.strip()][:_SHOWN_LINES]
        raise CertainRunError(
            f"--profile: {profiler.name} cannot observe a process:\n" + "\n".join(said),
            hint=_PERMIT[profiler.name],
            code=_UNUSABLE,
        )


_DURATION_NS = 5 * 10**9
"""How long is played if the plan has no iterations, only probes."""

_SLOWER = 4
"""A process with a profiler may take this much longer to start."""

_END_TIMEOUT_S = 120.0
_SAMPLE_NS = 100_000_000
"""How long after the end of a segment its last sample may be taken."""

_MAX_FILES = 100
_MAX_ERROR = 500


def profiled_processes(plan: Plan) -> tuple[ProcessPlan, ...]:
    """Return the processes to be observed: all that have nodes.

    Raises:
        UsageError: there is none.
    """
    processes = tuple(
        process
        for process in plan.processes_in(MEASURE_PHASE)
        if process.role in GRAPH_ROLES or process.nodes
    )
    if not processes:
        raise UsageError(
            "--profile: this run starts no process of the graph",
            hint="Profile external nodes where they are started, or let the spec start them.",
        )
    return processes


def profiled_rate(plan: Plan, peak_hz: float | None) -> tuple[float, int]:
    """Return the highest rate of the plan, or the peak, and the duration of the iteration in ns."""
    plays = [(play.rate_hz, play.duration_ns) for play in plan.play]
    if plan.play_at_peak is not None and peak_hz is not None:
        plays.append((peak_hz, plan.play_at_peak.duration_ns))
    if plays:
        return max(plays)
    lowest = plan.search.min_hz if plan.search is not None else 0.0
    return peak_hz or max(plan.sustained_hz, default=lowest), _DURATION_NS


def wait_for_last_sample(starts: StartSequence) -> None:
    """Wait until the last segment is over, including the CPU sample at the end of its period.

    A segment counts as played when its last answer has come, which is before that.

    Raises:
        RunError: a process exited or failed; what was measured is then not whole.
    """
    ended_ns = max(
        (segment.ended_ns for start in starts.starts for segment in start.segments), default=0
    )
    starts.context.supervisor.pump(0.0)
    starts.context.supervisor.pump_for((ended_ns + _SAMPLE_NS - time.monotonic_ns()) / 1e9)


def _play_start(starts: StartSequence, plan: Plan, play: Callable[[SegmentPlayer], object]) -> str:
    """Play in a start of its own, end all its processes, and return why it failed, if it did.

    Raises:
        InterruptedRunError: a signal interrupted the run.
    """
    supervisor = starts.context.supervisor
    try:
        play(starts.begin_uncounted(plan))
    except InterruptedRunError:
        raise
    except (R2bspecError, OSError) as failure:
        return clip(without_output(str(failure)), _MAX_ERROR)
    finally:
        # Nothing that ends from here on is a failure of the run.
        supervisor.end(list(supervisor))
    return ""


def play_profiled(
    starts: StartSequence, profiler: Profiler, peak_hz: float | None
) -> tuple[ProfileRecord, ...]:
    """Play one more iteration with a profiler, and return the outcome of each process.

    Raises:
        InterruptedRunError: a signal interrupted the run.
    """
    supervisor, folder = starts.context.supervisor, starts.context.folder
    names = [process.name for process in profiled_processes(starts.plan)]
    rate_hz, duration_ns = profiled_rate(starts.plan, peak_hz)
    processes = []
    for process in starts.plan.processes:
        if process.name in names and process.phase == MEASURE_PHASE:
            base = folder.profile_folder(process.name) / process.name
            argv = (*profiler.prefix(base), *process.argv)
            process = msgspec.structs.replace(process, argv=argv)
        processes.append(process)
    plan = msgspec.structs.replace(
        starts.plan,
        processes=tuple(processes),
        start_timeout=Duration(_SLOWER * starts.plan.start_timeout.ns),
    )

    def play(player: SegmentPlayer) -> None:
        player.play_unrecorded_for(titled(rate_hz, f"with {profiler.name}"), rate_hz, duration_ns)
        children = [process for process in supervisor if process.name in names]
        for child in children:
            child.request_shutdown()
        # A profiler writes its file when the process that it observes has ended.
        supervisor.pump_until(
            lambda: not any(child.is_running for child in children), _END_TIMEOUT_S
        )

    began_ns = time.monotonic_ns()
    error = _play_start(starts, plan, play)
    return tuple(
        ProfileRecord(
            process=name,
            profiler=profiler.name,
            files=(files := tuple(_profile_files(folder.path, name))),
            rate_hz=rate_hz,
            began_ns=began_ns,
            ended_ns=time.monotonic_ns(),
            error=error or ("" if files else f"{profiler.name} wrote no file in the run folder"),
        )
        for name in names
    )


def _profile_files(run: Path, process: str) -> Iterator[str]:
    """Yield what a profiler has written; it may choose names that are no text."""
    for path in sorted(regular_files(run / "profile" / process))[:_MAX_FILES]:
        yield printable(path.relative_to(run).as_posix())


def play_observed(starts: StartSequence, peak_hz: float | None) -> AnatomyRecord:
    """Play one more iteration, in a start that is observed from inside; it does not count.

    A failure becomes a part of the record.

    Raises:
        InterruptedRunError: a signal interrupted the run.
    """
    rate_hz, duration_ns = profiled_rate(starts.plan, peak_hz)
    heading = SegmentHeading("anatomy", "anatomy-001", titled(rate_hz, "observed from inside"))
    error = _play_start(
        starts,
        msgspec.structs.replace(starts.plan, anatomy=True),
        lambda player: player.play_for(heading, rate_hz, duration_ns),
    )
    start = starts.starts[-1]
    record = start.anatomy.record if start.anatomy else AnatomyRecord(start=start.number)
    return msgspec.structs.replace(record, error=error or record.error)
