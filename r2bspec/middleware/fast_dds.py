"""Fast DDS, which rmw_fastrtps_cpp and its dynamic variant use.

Its XML profile configures a transport and the size of the segments in shared memory. Fast DDS holds
a lock on ``NAME_el`` as long as a participant uses the segment NAME; if the lock can be taken, no
participant does. A segment that has lost its lock file is dead if no process maps it. Segments of
the living, and those of other users, are never touched.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import stat
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from r2bspec.middleware import middleware

_SEGMENT_MESSAGES = 24
"""How many of the largest message a shared-memory segment holds: a writer's queue of ten, the
same again on its way through readers, and room for small ones."""

_SEGMENT_MINIMUM = 8 << 20
_SEGMENT_MAXIMUM = 4095 << 20
"""The middleware keeps the size in 32 bits."""

# Processes that miss each other's first announcements meet at the next ones. By default there are
# five of these in half a second, and then one every three seconds, for which every start waited.
_PROFILE = """\
<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <profiles>
    <transport_descriptors>
{transports}
    </transport_descriptors>
    <participant profile_name="r2bspec" is_default_profile="true">
      <rtps>
        <userTransports>{names}</userTransports>
        <useBuiltinTransports>false</useBuiltinTransports>
        <builtin>
          <discovery_config>
            <leaseAnnouncement><nanosec>500000000</nanosec></leaseAnnouncement>
            <initialAnnouncements>
              <count>30</count>
              <period><nanosec>100000000</nanosec></period>
            </initialAnnouncements>
          </discovery_config>
          <metatrafficUnicastLocatorList><locator/></metatrafficUnicastLocatorList>
          <initialPeersList>
            <locator><udpv4><address>127.0.0.1</address></udpv4></locator>
          </initialPeersList>
        </builtin>
      </rtps>
    </participant>
  </profiles>
</dds>
"""

SOCKET_BUFFER_BYTES = 16 << 20
"""What each UDP socket asks the kernel for: the fragments of an image of 1920x1200 come as one
burst, and the kernel counts more than their bytes. It grants no more than net.core.rmem_max and
wmem_max; with 4 MiB a twentieth of those fragments was lost and sent again."""

_MAX_PARTICIPANTS = 64
"""How many processes of a domain find each other without multicast; each is asked by its port."""

_UDP = f"""\
      <transport_descriptor>
        <transport_id>udp</transport_id>
        <type>UDPv4</type>
        <sendBufferSize>{SOCKET_BUFFER_BYTES}</sendBufferSize>
        <receiveBufferSize>{SOCKET_BUFFER_BYTES}</receiveBufferSize>
        <maxInitialPeersRange>{_MAX_PARTICIPANTS}</maxInitialPeersRange>
        <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
      </transport_descriptor>"""

_SHARED_MEMORY = """\
      <transport_descriptor>
        <transport_id>shm</transport_id>
        <type>SHM</type>
        <segment_size>{segment}</segment_size>
        <maxMessageSize>{message}</maxMessageSize>
      </transport_descriptor>"""


def default_segment_bytes(largest_message_bytes: int) -> int:
    """Return the size of a shared-memory segment for messages up to this size, in bytes."""
    required_bytes = _SEGMENT_MESSAGES * (largest_message_bytes + 4096)
    return min(max(_SEGMENT_MINIMUM, required_bytes), _SEGMENT_MAXIMUM)


def transport_profile(transport: str, largest_message_bytes: int, segment: int = 0) -> str:
    """Return the Fast DDS profile of a transport, as XML.

    Discovery needs UDP, and knows this host only: it asks ports of the loopback device instead of
    a multicast group. Messages then take shared memory where both sides have it. With the default
    segment of 512 KiB an image would travel in fragments, at ten times the latency.

    Args:
        transport: ``shared_memory`` or ``udp``.
        largest_message_bytes: what a segment is sized by.
        segment: its size in bytes, where the spec asks for one; 0 otherwise.
    """
    if transport == "udp":
        return _PROFILE.format(transports=_UDP, names="<transport_id>udp</transport_id>")
    segment = segment or default_segment_bytes(largest_message_bytes)
    shared = _SHARED_MEMORY.format(segment=segment, message=segment // 2)
    return _PROFILE.format(
        transports=f"{shared}\n{_UDP}",
        names="<transport_id>shm</transport_id><transport_id>udp</transport_id>",
    )


_OTHERS = 0o077

_LOCKS = ("_el", "_sl")
_FILES = ("fastrtps_*", "fastdds_*", "sem.fastrtps_*", "sem.fastdds_*")


def shm_files(memory: Path = middleware.SHARED_MEMORY) -> list[str]:
    """Return the names of the middleware's files in shared memory, whoever owns them."""
    return sorted(path.name for pattern in _FILES for path in memory.glob(pattern))


def _lock(memory: Path, name: str) -> Path:
    return memory / f"{name}_el"


def _ours(file: Path, since_s: float) -> bool:
    status = file.stat()
    return status.st_uid == os.getuid() and status.st_mtime >= since_s


def _is_free(lock: Path) -> bool:
    with lock.open("rb") as file:
        try:
            # Shared, so that two who look at the same time do not see each other.
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


def _mapped(memory: Path, processes: Iterable[Path]) -> set[str]:
    """Return the names of segments that some processes map, by their folders."""
    # A line that goes on with "(deleted)" is about an earlier segment of that name.
    pattern = re.compile(rf"{re.escape(str(memory))}/((?:sem\.)?fast\S+)$", re.MULTILINE)
    mapped: set[str] = set()
    for process in processes:
        with contextlib.suppress(OSError):
            mapped.update(pattern.findall((process / "maps").read_text(errors="replace")))
    return mapped


_PORTS_BYTES = 1 << 20
"""What a process takes in addition to its segment: ports, discovery, locks. 0.7 MB were seen."""

_VENDOR_ID = b"\x01\x0f"


class FastDds(middleware.Middleware):
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
    distributions = ("fastrtps", "rmw-fastrtps-cpp")
    socket_buffers = middleware.SocketBuffers(SOCKET_BUFFER_BYTES, SOCKET_BUFFER_BYTES)
    exit_in_turn_s = 3.0
    may_hang_on_exit = True
    uses_shared_memory = True

    def configure(self, transport: middleware.MessageTransport, folder: Path) -> Mapping[str, str]:
        """Write the profile of a transport."""
        if transport.kind == "inherit":
            return middleware.HOST_ONLY
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

    def segment_bytes(self, transport: middleware.MessageTransport) -> int:
        """Return the segment of each process: the full size, unless it uses UDP alone."""
        if transport.kind != "shared_memory":
            return 0
        return transport.segment_bytes or default_segment_bytes(transport.largest_message_bytes)

    def required_shm_bytes(self, processes: int, segment_bytes: int) -> int:
        """Return the size of the segments and of the further files of the processes."""
        return processes * (segment_bytes + _PORTS_BYTES)

    def may_be_endpoint_of(self, gid: bytes, pids: Collection[int]) -> bool:
        """Compare the process numbers with that in a GUID, which has vendor, host and process.

        Vendor, host and process take two bytes each; for the process it is the low bytes of its
        number.
        """
        number = int.from_bytes(gid[4:6], "little")
        return gid[:2] == _VENDOR_ID and any(pid & 0xFFFF == number for pid in pids)

    def readable_shm_files(self, memory: Path = middleware.SHARED_MEMORY) -> list[str]:
        """Return the names of this user's files that other users may read."""
        names = []
        for name in shm_files(memory):
            with contextlib.suppress(OSError):
                status = (memory / name).lstat()
                is_own = stat.S_ISREG(status.st_mode) and status.st_uid == os.geteuid()
                if is_own and status.st_mode & _OTHERS:
                    names.append(name)
        return names

    def make_shm_files_private(
        self,
        pids: Iterable[int],
        memory: Path = middleware.SHARED_MEMORY,
        proc: Path = middleware.PROC,
    ) -> None:
        """Take all rights to the segments of some processes from other users.

        Fast DDS gives them the mode 0644 whatever the umask.
        """
        readable = self.readable_shm_files(memory)
        if not readable:
            return
        flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC
        for name in _mapped(memory, (proc / str(pid) for pid in pids)).intersection(readable):
            with (
                contextlib.suppress(OSError),
                os.fdopen(os.open(memory / name, flags), "rb") as file,
            ):
                # It may have been replaced since it was looked at.
                if os.fstat(file.fileno()).st_uid == os.geteuid():
                    os.fchmod(file.fileno(), 0o600)

    def dead_shm_files(
        self,
        memory: Path = middleware.SHARED_MEMORY,
        proc: Path = middleware.PROC,
        since_s: float = 0.0,
    ) -> list[str]:
        """Return the names of this user's segments that nobody uses; nothing is changed.

        Args:
            memory: the folder of shared memory.
            proc: the folder of processes.
            since_s: only what was made after this time counts (seconds since the epoch).
        """
        # A lock may be all that is left of a segment.
        names = {path.name.removesuffix("_el") for path in memory.glob("fast*")}
        mapped: set[str] | None = None
        dead = []
        for name in sorted(file_name for file_name in names if not file_name.endswith(_LOCKS)):
            lock = _lock(memory, name)
            with contextlib.suppress(OSError):
                if lock.exists():
                    free = _ours(lock, since_s) and _is_free(lock)
                elif free := _ours(memory / name, since_s):
                    mapped = _mapped(memory, proc.glob("[0-9]*")) if mapped is None else mapped
                    free = name not in mapped
                if free:
                    dead.append(name)
        return dead

    def remove_dead_shm_files(
        self,
        memory: Path = middleware.SHARED_MEMORY,
        proc: Path = middleware.PROC,
        since_s: float = 0.0,
    ) -> list[str]:
        """Remove the segments that `dead_shm_files` finds; returns their names."""
        removed = []
        for name in self.dead_shm_files(memory, proc, since_s):
            with contextlib.suppress(OSError), contextlib.ExitStack() as held:
                if _lock(memory, name).exists():
                    # Held until all is gone, so that nobody takes up what is being removed.
                    file = held.enter_context(_lock(memory, name).open("rb"))
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                for path in (memory / name, memory / f"sem.{name}_mutex", _lock(memory, name)):
                    path.unlink(missing_ok=True)
                removed.append(name)
        return removed


MIDDLEWARE = FastDds()
