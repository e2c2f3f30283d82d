"""What processes need before they start: programs, middleware, shared memory.

`r2bspec validate` makes the same checks of the transport of a spec; a plan from a file was not
validated here, and the RMW that is loaded if none is named depends on the installation.

A segment of shared memory of the full size is taken for each process when it starts. Where that
fails, the middleware says so in the log of that process and goes on over UDP: with images the graph
is then ten times slower, and nothing tells why. A run therefore looks before it starts anything. It
also keeps other users out of its shared memory, which the umask does not do.
"""

from __future__ import annotations

import contextlib
import os
import random
import resource
import shutil
import socket
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

from r2bspec import harness
from r2bspec.diagnostics.quote import clip
from r2bspec.execute import errors
from r2bspec.judge.measure.units import show
from r2bspec.middleware.middleware import (
    RMW_VARIABLE,
    SHARED_MEMORY,
    Middleware,
    TransportKind,
    middleware_of,
    refuse_transport,
    selected_rmw,
)
from r2bspec.native.build import BuildError, harness_library, harness_program
from r2bspec.plan.command_lines import EXECUTABLE
from r2bspec.plan.plan import Plan, ProcessPlan
from r2bspec.plan.this_machine import PACKAGE_INDEX, ament_prefixes


def resolve_argv(plan: ProcessPlan) -> list[str]:
    """Return the command line of a process, with the interpreter and full paths of executables.

    Raises:
        NotInstalledError: a package, executable or program is not on this machine.
    """
    argv = resolve_command(plan.argv, f"process {plan.name}")
    if hosts_library(plan):
        built(harness_library)
    return argv


def hosts_library(plan: ProcessPlan) -> bool:
    """Return True if player and monitor run in a process of Python nodes."""
    return plan.role == "harness" and bool(plan.nodes)


def built(make: Callable[[], Path]) -> Path:
    """Return the file of a program or a library of r2bspec, and build it on first use.

    Raises:
        NotInstalledError: it cannot be built on this machine (R2B668).
    """
    try:
        return make()
    except BuildError as error:
        raise errors.NotInstalledError(str(error), hint=error.hint, code=error.code) from error


def resolve_command(words: Sequence[str], what: str) -> list[str]:
    """Resolve a command; `what` names its owner in the error.

    Raises:
        NotInstalledError: a package, executable or program is not on this machine.
    """
    argv = [_resolve(word) for word in words]
    if "/" not in argv[0]:
        program = shutil.which(argv[0])
        if program is None:
            raise errors.NotInstalledError(
                f"{what}: program {argv[0]!r} is not on PATH",
                hint="Install it, or correct the command in the spec.",
                code="R2B621",
            )
        argv[0] = program
    return argv


def _resolve(word: str) -> str:
    if word == "$(python)":
        return sys.executable
    if word == "$(harness)":
        return _harness()
    if word == "$(included_launch)":
        return str(Path(harness.__file__).with_name("included_launch.py"))
    matched = EXECUTABLE.fullmatch(word)
    return str(find_executable(matched["package"], matched["name"])) if matched else word


@cache
def _harness() -> str:
    """Find the program of player and monitor once: its digest reads about all headers of ROS."""
    return str(built(harness_program))


def find_executable(package: str, name: str) -> Path:
    """Return the executable of an ament package: ``PREFIX/lib/PACKAGE/NAME``.

    Raises:
        NotInstalledError: no prefix in AMENT_PREFIX_PATH has the package or the executable.
    """
    prefixes = ament_prefixes()
    folders = [
        prefix / "lib" / package
        for prefix in prefixes
        if (prefix / PACKAGE_INDEX / package).exists()
    ]
    if not folders:
        raise errors.NotInstalledError(
            f"ROS package {package!r} is not installed in {len(prefixes)} ament prefixes",
            hint="Install it, or source the workspace that contains it.",
            code="R2B622",
        )
    executables = {
        path.name: path
        for folder in reversed(folders)
        for path in folder.glob("*")
        if path.is_file() and os.access(path, os.X_OK)
    }
    if name not in executables:
        raise errors.NotInstalledError(
            f"ROS package {package!r} has no executable {name!r}",
            hint=f"Its executables: {', '.join(sorted(executables)) or 'none'}.",
            code="R2B623",
        )
    return executables[name]


_MIN_DOMAIN, _MAX_DOMAIN = 1, 100
"""Domains whose UDP ports (7400 + 250 x domain) are outside of the ephemeral range of Linux."""
_LAST_DOMAIN = 232
"""The last that has UDP ports: of the next, they are beyond 65,535."""

_PORT_BASE = 32768
"""The convention of ROS's `domain_coordinator`: a process that binds TCP port 32768 + N has
domain N. It also avoids collisions with test suites that use it."""

_SEGMENT_LOOK_S = 1.0
_SEGMENT_LOOKS = 3
"""How often a file is looked at: a process maps its segment a moment after it has made it. A look
reads about every process of the machine, which takes 20 to 40 ms while a graph starts."""


def check_middleware(plan: Plan, environ: Mapping[str, str]) -> None:
    """Check that the transport of a plan can be configured for every process.

    Args:
        plan: says which transport, and what processes have in their own environment.
        environ: what r2bspec runs in, of which the processes inherit the selection.

    Raises:
        MiddlewareError: it cannot.
    """
    require_configurable(plan.transport, selected_rmw(environ), RMW_VARIABLE)
    for process in plan.processes:
        if rmw := process.env.get(RMW_VARIABLE):
            require_configurable(plan.transport, rmw, f"{RMW_VARIABLE} of {process.name}")


def require_configurable(kind: TransportKind, rmw: str, selected_by: str) -> None:
    """Check that a transport can be configured for an RMW implementation.

    Raises:
        MiddlewareError: it cannot; the error says what has selected it.
    """
    refusal = refuse_transport(kind, rmw)
    if refusal is not None:
        hint = f"{refusal.help[0].upper()}{refusal.help[1:]}."
        raise errors.MiddlewareError(f"{refusal.message}, which {selected_by} selects", hint=hint)


@contextlib.contextmanager
def reserved_domain() -> Iterator[int]:
    """Reserve a free domain for the block.

    The reservation is a bound port, which the kernel releases when the process exits.

    Raises:
        CertainRunError: this machine's processes cannot reach one another (R2B699).
        RunError: all domains are taken.
    """
    require_loopback()
    domains = range(_MIN_DOMAIN, _MAX_DOMAIN + 1)
    for domain in random.sample(domains, len(domains)):
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as guard:
            try:
                guard.bind(("127.0.0.1", _PORT_BASE + domain))
            except OSError:
                continue
            yield domain
            return
    raise errors.RunError(
        f"all ROS domains from {_MIN_DOMAIN} to {_MAX_DOMAIN} are in use on this machine",
        hint="Wait until other runs have finished.",
    )


def domain_of_user() -> int:
    """Return the domain of the user, in which external nodes run.

    Raises:
        CertainRunError: the environment names none (R2B655).
    """
    text = (os.environ.get("ROS_DOMAIN_ID") or "0").strip()
    if not (text.isascii() and text.isdigit() and int(text) <= _LAST_DOMAIN):
        raise errors.CertainRunError(
            f"ROS_DOMAIN_ID is {clip(text)!r}, no number from 0 to {_LAST_DOMAIN}",
            hint="Set it to the domain of the nodes that already run, or unset it.",
            code="R2B655",
        )
    return int(text)


def require_loopback() -> None:
    """Check that two processes of this machine reach each other over 127.0.0.1.

    Every middleware discovers over it; without it nodes start and never discover each other.

    Raises:
        CertainRunError: nothing can be sent (R2B699).
    """
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
            receiver.bind(("127.0.0.1", 0))
            receiver.sendto(b"", receiver.getsockname())
    except OSError as error:
        raise errors.CertainRunError(
            f"processes cannot reach one another over 127.0.0.1: {error.strerror or error}",
            hint="Bring the loopback interface up: ip link set lo up (in a new network namespace "
            "it is down).",
            code="R2B699",
        ) from error


def require_free_shared_memory(
    plan: Plan,
    phase: str,
    middleware: Middleware,
    segment_bytes: int,
    folder: Path = SHARED_MEMORY,
) -> None:
    """Check that the processes of a phase have the shared memory that they are configured to use.

    A launch file counts as one process, because it is unknown how many it starts.

    Args:
        plan: says who runs in the phase.
        phase: ``preprocess`` or ``measure``.
        middleware: takes the segments.
        segment_bytes: the size of each segment; 0 where the run decides nothing about it.
        folder: where shared memory lies.

    Raises:
        CertainRunError: there is less room (R2B664).
    """
    if not segment_bytes:
        return
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise errors.CertainRunError(
            f"there is no shared memory in {folder}: {error.strerror or error}",
            hint="Mount a tmpfs there, or state transport: udp.",
            code="R2B664",
        ) from error
    largest_file = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    if largest_file != resource.RLIM_INFINITY and largest_file < segment_bytes:
        raise errors.CertainRunError(
            f"the size of a file is limited to {show(largest_file, 'B')} (ulimit -f); a segment of "
            f"shared memory needs {show(segment_bytes, 'B')}",
            hint="Raise the limit (ulimit -f unlimited), or state transport: udp, or smaller "
            "segments (transport: {kind: shared_memory, segment: ...}).",
            code="R2B664",
        )
    # The observer, which no plan lists, runs with the measured graph.
    processes = len(plan.processes_in(phase)) + (phase == "measure")
    required_bytes = middleware.required_shm_bytes(processes, segment_bytes)
    if free < required_bytes:
        suggested_mib = -(-required_bytes * 5 // (4 << 20))  # with some to spare
        raise errors.CertainRunError(
            f"{folder} has {show(free, 'B')} free; the {processes} processes of the {phase} phase "
            f"need {show(required_bytes, 'B')}, a segment of {show(segment_bytes, 'B')} each",
            hint=f"Make it larger (in a container: --shm-size={suggested_mib}m; else: mount -o "
            f"remount,size={suggested_mib}m {folder}), or state transport: udp, or smaller "
            "segments (transport: {kind: shared_memory, segment: ...}). 'r2bspec doctor --clean' "
            "frees what dead runs have left.",
            code="R2B664",
        )


class SharedMemoryModes:
    """The shared memory of a run's processes, made private soon after its creation."""

    def __init__(self, pids: Callable[[], Iterable[int]]) -> None:
        self._pids = pids
        self._middleware = middleware_of(os.environ)
        self._attempts: dict[str, int] = {}
        self._next_s = 0.0

    def make_private(self) -> None:
        """Look for new segments, at most once a second, and make them private.

        Segments of other programs stay readable, and are not examined again.
        """
        if time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + _SEGMENT_LOOK_S
        readable = self._middleware.readable_shm_files()
        self._attempts = {name: self._attempts.get(name, 0) + 1 for name in readable}
        if any(number <= _SEGMENT_LOOKS for number in self._attempts.values()):
            self._middleware.make_shm_files_private(self._pids())
