"""What a run, its clean-up and the doctor ask of a ROS middleware (RMW), and which is selected.

The answers here are right for an unknown RMW: it is not configured, it needs no workaround, and
discovery is kept on this host by the variable that ROS 2 has for that. A module for an RMW
overrides what differs: every module of this package that has a MIDDLEWARE is about one RMW. They
are imported when the first question is asked.
"""

from __future__ import annotations

import fnmatch
import pkgutil
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Final, Literal, NamedTuple

import r2bspec.middleware

TransportKind = Literal["inherit", "shared_memory", "udp"]

SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - the place is fixed by POSIX shared memory
PROC = Path("/proc")

HOST_ONLY = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
"""How ROS 2 itself, from Iron on, says that nodes discover those of this host only."""


DISCOVERY_VARIABLES: Final = (
    "ROS_DISCOVERY_SERVER",
    "ROS_SUPER_CLIENT",
    "ROS_STATIC_PEERS",
    "ROS_LOCALHOST_ONLY",
    "FASTDDS_ENVIRONMENT_FILE",
)
"""By these, nodes ask a server, other hosts or this host alone for each other. Processes of a run
inherit them only where the spec names them."""

_SET_BY_RUNS: Final = ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "RMW_IMPLEMENTATION")
"""A node for which the spec sets one of these differently may never meet the others."""


def discovery_settings(
    environ: Mapping[str, str],
    transport: TransportKind,
    named: Collection[str],
    of_processes: Mapping[str, Iterable[str]],
) -> str:
    """Return the settings that keep processes from discovering each other, as a sentence.

    Args:
        environ: the environment of r2bspec.
        transport: the transport of the run; all but `inherit` have a configuration of their own.
        named: the variables that the spec passes on.
        of_processes: those that it sets for single processes.

    Returns:
        Empty if no variable changes the discovery.
    """
    patterns = middleware_of(environ).variables if transport == "inherit" else ()
    configured = [
        name for name in environ if any(fnmatch.fnmatchcase(name, each) for each in patterns)
    ]
    passed = [name for name in DISCOVERY_VARIABLES if name in named and environ.get(name)]
    passed += [name for name in configured if environ[name] and name not in passed]
    changes = {*DISCOVERY_VARIABLES, *_SET_BY_RUNS}
    passed += [
        f"{name} (of {process})"
        for process, names in of_processes.items()
        for name in names
        if name in changes
    ]
    if not passed:
        return ""
    return f"{', '.join(passed)} can change which nodes discover each other: run without"


@dataclass(frozen=True)
class MessageTransport:
    """How the messages of a run are to travel.

    Attributes:
        kind: as the spec says it.
        largest_message_bytes: what shared memory is sized by.
        segment_bytes: the size of a segment of shared memory that the spec asks for; 0 leaves it to
            the largest message.
    """

    kind: TransportKind
    largest_message_bytes: int
    segment_bytes: int = 0


@dataclass(frozen=True)
class SocketBuffers:
    """The bytes that each UDP socket asks the kernel for; 0 means the default."""

    receive: int = 0
    send: int = 0


class Middleware:
    """A ROS middleware (RMW).

    Attributes:
        name: what users read.
        implementations: the values of RMW_IMPLEMENTATION that select it.
        transports: the values of the spec's ``transport`` that it can be configured for.
        variables: patterns of the environment variables that configure it, which processes of a
            run inherit.
        override_variables: those of them that can let discovery leave the host, where the user
            sets them: what they say has priority over what a run sets.
        distributions: the Python distributions whose versions a run records.
        socket_buffers: what its sockets ask for.
        exit_in_turn_s: for how long at most the processes of a run are ended one by one, each
            after the one before it has ended; then the rest are asked to end at once.
        may_hang_on_exit: whether a process of the harness may hang while it leaves the RMW, and
            needs a timer that ends it all the same.
        uses_shared_memory: whether its processes have files in `SHARED_MEMORY`.
    """

    name: str
    implementations: tuple[str, ...] = ()
    transports: tuple[TransportKind, ...] = ("inherit",)
    variables: tuple[str, ...] = ()
    override_variables: tuple[str, ...] = ()
    distributions: tuple[str, ...] = ()
    socket_buffers = SocketBuffers()
    exit_in_turn_s: float = 0.0
    may_hang_on_exit: bool = False
    uses_shared_memory: bool = False

    def configure(self, transport: MessageTransport, folder: Path) -> Mapping[str, str]:
        """Configure a transport of `transports`; any other is left to the RMW.

        Args:
            transport: how messages are to travel.
            folder: where files go that the variables name; it is kept as long as the run.

        Returns:
            What the environment of each process has in addition.
        """
        del transport, folder
        return HOST_ONLY

    def segment_bytes(self, transport: MessageTransport) -> int:
        """Return the shared memory that each process takes when it starts.

        0 if the RMW decides that.
        """
        del transport
        return 0

    def required_shm_bytes(self, processes: int, segment_bytes: int) -> int:
        """Return the bytes of shared memory that the processes need to start."""
        return processes * segment_bytes

    def may_be_endpoint_of(self, gid: bytes, pids: Collection[int]) -> bool:
        """Return True if an endpoint with this identifier can belong to one of some processes.

        Unknown identifiers can belong to any process.
        """
        del gid, pids
        return True

    def readable_shm_files(self) -> list[str]:
        """Return the names of this user's files in shared memory that other users may read."""
        return []

    def make_shm_files_private(self, pids: Iterable[int]) -> None:
        """Take all rights to the shared memory that some processes use from other users."""
        del pids

    def dead_shm_files(
        self, memory: Path = SHARED_MEMORY, proc: Path = PROC, since_s: float = 0.0
    ) -> list[str]:
        """Return the names of what dead processes of this user left in shared memory.

        Changes nothing.

        Args:
            memory: the folder of shared memory.
            proc: the folder of processes.
            since_s: only what was made after this time counts (seconds since the epoch).
        """
        del memory, proc, since_s
        return []

    def remove_dead_shm_files(
        self, memory: Path = SHARED_MEMORY, proc: Path = PROC, since_s: float = 0.0
    ) -> list[str]:
        """Remove what `dead_shm_files` finds, and return the names."""
        del memory, proc, since_s
        return []


class UnknownMiddleware(Middleware):
    """An RMW that has no module here, such as that for Zenoh or Connext.

    Zenoh ignores the discovery settings of ROS 2: its sessions find each other through a router
    that the user starts, by default a router on this host.
    """

    variables = ("ZENOH_*",)
    override_variables = ("ZENOH_SESSION_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE")

    def __init__(self, rmw: str) -> None:
        self.name = rmw
        self.implementations = (rmw,)


RMW_VARIABLE = "RMW_IMPLEMENTATION"

_DEFAULT = "rmw_fastrtps_cpp"
"""What ROS 2 Jazzy takes where the variable is not set, or empty."""


class TransportRefusal(NamedTuple):
    """Why the selected middleware does not support a transport, and the remedies."""

    message: str
    help: str


@cache
def known_middlewares() -> tuple[Middleware, ...]:
    """Return every RMW that has a module here, in the order of their names."""
    package = r2bspec.middleware
    modules = [
        import_module(module.name)
        for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}.")
        if module.name != __name__
    ]
    middlewares: list[Middleware] = [
        module.MIDDLEWARE for module in modules if hasattr(module, "MIDDLEWARE")
    ]
    return tuple(sorted(middlewares, key=lambda each: each.name))


@cache
def middleware_named(rmw: str) -> Middleware:
    """Return the RMW of an implementation, such as ``rmw_cyclonedds_cpp``."""
    for middleware in known_middlewares():
        if rmw in middleware.implementations:
            return middleware
    return UnknownMiddleware(rmw)


def selected_rmw(environ: Mapping[str, str]) -> str:
    """Return the implementation that processes with this environment load."""
    return environ.get(RMW_VARIABLE) or _DEFAULT


def middleware_of(environ: Mapping[str, str]) -> Middleware:
    """Return the RMW that processes with this environment load."""
    return middleware_named(selected_rmw(environ))


def inherited_variables() -> tuple[str, ...]:
    """Return patterns of the variables by which users configure any RMW."""
    unknown = UnknownMiddleware.variables
    return (
        tuple(name for middleware in known_middlewares() for name in middleware.variables) + unknown
    )


def refuse_transport(kind: TransportKind, rmw: str) -> TransportRefusal | None:
    """Return why an implementation cannot be configured for a transport; None if it can."""
    middleware = middleware_named(rmw)
    if kind in middleware.transports:
        return None
    others = " or ".join(
        rmw
        for known in known_middlewares()
        if kind in known.transports
        for rmw in known.implementations[:1]
    )
    return TransportRefusal(
        f"'transport: {kind}' cannot be configured with {rmw}",
        f"write 'transport: inherit', which leaves the transport to {middleware.name}; or unset "
        f"{RMW_VARIABLE}, or set it to {others}",
    )
