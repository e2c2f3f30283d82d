"""Fast DDS, which rmw_fastrtps_cpp and its dynamic variant use."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from r2bspec.middleware import fast_dds_shm_files
from r2bspec.middleware.fast_dds_profile import (
    SOCKET_BUFFER_BYTES,
    default_segment_bytes,
    transport_profile,
)
from r2bspec.middleware.middleware import (
    HOST_ONLY,
    PROC,
    SHARED_MEMORY,
    Middleware,
    SocketBuffers,
    Transport,
)

_PORTS_BYTES = 1 << 20
"""What a process takes in addition to its segment: ports, discovery, locks. 0.7 MB were seen."""

_VENDOR_ID = b"\x01\x0f"


class FastDds(Middleware):
    """See the module.

    Processes end one after another, and those of the harness with a timer, because of a deadlock in
    Fast DDS 2.14: while a participant leaves, `DomainParticipant::set_listener` waits for a
    callback of discovery to return; that callback, which runs if another participant leaves at the
    same time, waits for a lock that the caller of `set_listener` holds. The wait is in native code
    that holds the interpreter's lock.
    """

    name = "Fast DDS"
    implementations = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")
    transports = ("inherit", "shared_memory", "udp")
    variables = ("FASTRTPS_*", "FASTDDS_*")
    # Static peers stay: with a profile they have no effect, and with 'inherit' they are the user's.
    removed_variables = ("ROS_LOCALHOST_ONLY",)
    distributions = ("fastrtps", "rmw-fastrtps-cpp")
    socket_buffers = SocketBuffers(SOCKET_BUFFER_BYTES, SOCKET_BUFFER_BYTES)
    exit_in_turn_s = 3.0
    may_hang_on_exit = True
    uses_shared_memory = True

    def configure(self, transport: Transport, folder: Path) -> Mapping[str, str]:
        """Write the profile of a transport."""
        if transport.kind == "inherit":
            return HOST_ONLY
        profile = folder / "transport.xml"
        profile.write_text(
            transport_profile(
                transport.kind, transport.largest_message_bytes, transport.segment_bytes
            )
        )
        return {
            # The profile says how processes find each other. With LOCALHOST the middleware would
            # add shared memory of 512 KiB to its transports, and prefer that to UDP: images would
            # go through it in fragments, at ten times the latency.
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile),
            "FASTDDS_DEFAULT_PROFILES_FILE": str(profile),
        }

    def segment_bytes(self, transport: Transport) -> int:
        """Each process takes a segment of the full size, unless it uses UDP alone."""
        if transport.kind != "shared_memory":
            return 0
        return transport.segment_bytes or default_segment_bytes(transport.largest_message_bytes)

    def required_shm_bytes(self, processes: int, segment_bytes: int) -> int:
        """The segments, and what each process takes in addition."""
        return processes * (segment_bytes + _PORTS_BYTES)

    def may_be_endpoint_of(self, gid: bytes, pids: Collection[int]) -> bool:
        """Compare the number of the process in a GUID: vendor, host, process, and others after it.

        The vendor, the host and the process take two bytes each; of a process it is the low ones.
        """
        number = int.from_bytes(gid[4:6], "little")
        return gid[:2] == _VENDOR_ID and any(pid & 0xFFFF == number for pid in pids)

    def readable_shm_files(self) -> list[str]:
        """Its files are there for as long as a participant is."""
        return fast_dds_shm_files.readable_shm_files()

    def make_shm_files_private(self, pids: Iterable[int]) -> None:
        """The segments and ports that these processes map."""
        fast_dds_shm_files.make_shm_files_private(pids)

    def dead_shm_files(
        self, memory: Path = SHARED_MEMORY, proc: Path = PROC, since_s: float = 0.0
    ) -> list[str]:
        """The names of segments whose processes are dead."""
        return fast_dds_shm_files.dead_shm_files(memory, proc, since_s)

    def remove_dead_shm_files(
        self, memory: Path = SHARED_MEMORY, proc: Path = PROC, since_s: float = 0.0
    ) -> list[str]:
        """Remove those segments, with their locks."""
        return fast_dds_shm_files.remove_dead_shm_files(memory, proc, since_s)


MIDDLEWARE = FastDds()
