"""The environment of every process of a run: what is inherited, and what the run adds.

Only variables that running ROS programs need are inherited. Secrets that a CI system keeps in
the environment therefore never reach a node, unless the spec names them under ``environment:``.
"""

from __future__ import annotations

import fnmatch
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

from r2bspec.execute.processes.secret_references import SecretReferences
from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from r2bspec.plan.plan import Plan

_INHERITED_PATTERNS = (
    *("PATH", "HOME", "USER", "LOGNAME", "SHELL", "LANG", "LC_*", "TZ", "TMPDIR", "TERM"),
    *("PYTHON*", "VIRTUAL_ENV", "CONDA_PREFIX", "LD_LIBRARY_PATH", "LD_PRELOAD", "XDG_*"),
    *("ROS_*", "_ROS_*", "AMENT_*", "COLCON_*", "CMAKE_PREFIX_PATH", "RMW_*", "RCUTILS_*", "RCL_*"),
    *("FASTRTPS_*", "FASTDDS_*", "CYCLONEDDS_*", "ZENOH_*", "R2B_DATASETS"),
    *("CUDA_*", "NVIDIA_*", "HIP_*", "ROCR_*", "HSA_*", "LIBGL_*", "VK_*", "__GLX_*", "__NV_*"),
    *("OMP_*", "KMP_*", "MKL_*", "OPENBLAS_*", "OPENCV_*", "TBB_*", "MALLOC_*", "GLIBC_TUNABLES"),
    *("DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "QT_*", "GZ_*", "COVERAGE_*"),
)

_HARNESS_ALLOCATOR = {
    # glibc gives every large buffer back to the kernel and faults it in again for the next
    # message; keeping them saves three quarters of the time of a raw receive of an image.
    "MALLOC_MMAP_MAX_": "0",
    "MALLOC_TRIM_THRESHOLD_": str(1 << 30),
    "MALLOC_TOP_PAD_": str(64 << 20),
    # Buffers in huge pages, where the kernel gives them to those who ask: copying an image touches
    # a thousand small ones.
    "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1",
}

_SEGMENT_MESSAGES = 24
"""How many of the largest message a shared-memory segment holds: a writer's queue of ten, the
same again on its way through readers, and room for small ones."""

_MIN_SEGMENT_BYTES = 8 << 20
_MAX_SEGMENT_BYTES = 4095 << 20
"""The middleware keeps the size in 32 bits."""

# Processes that miss each other's first announcements meet at the next ones. By default there are
# five of these in half a second, and then one every three seconds, for which every start waited;
# player and monitor are older than the graph by as long as the floor takes.
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


def inherited_environment(environ: Mapping[str, str], named: Iterable[str]) -> dict[str, str]:
    """The part of an environment that processes of a run get."""
    patterns = (*_INHERITED_PATTERNS, *named)
    return {
        name: value
        for name, value in environ.items()
        if any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)
    }


def segment_bytes(largest_message_bytes: int) -> int:
    """The size of a shared-memory segment for messages up to this size, in bytes."""
    wanted = _SEGMENT_MESSAGES * (largest_message_bytes + 4096)
    return min(max(_MIN_SEGMENT_BYTES, wanted), _MAX_SEGMENT_BYTES)


def transport_profile(transport: str, largest_message_bytes: int, segment: int = 0) -> str:
    """The Fast DDS profile of a transport, as XML.

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
    segment = segment or segment_bytes(largest_message_bytes)
    shared = _SHARED_MEMORY.format(segment=segment, message=segment // 2)
    return _PROFILE.format(
        transports=f"{shared}\n{_UDP}",
        names="<transport_id>shm</transport_id><transport_id>udp</transport_id>",
    )


def uses_fast_dds(environ: Mapping[str, str]) -> bool:
    """Whether the middleware is Fast DDS, which is all that profiles and segments mean anything to.

    It is where nothing else is named.
    """
    return environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp").startswith("rmw_fastrtps")


class RunEnvironment:
    """The environments of one run's processes.

    Attributes:
        secrets: the values to which commands, variables and parameters of the plan refer.
        segment_bytes: the shared memory that each process takes when it starts; 0 where that is
            not for the run to decide.
    """

    def __init__(
        self,
        plan: Plan,
        *,
        run_id: str,
        domain: int,
        scratch: Path,
        largest_message_bytes: int,
        ros_logs: Path | None = None,
    ) -> None:
        self.secrets = SecretReferences(plan.environment, os.environ)
        self._common = inherited_environment(os.environ, plan.environment)
        if path := self._common.get("PYTHONPATH"):
            # Processes run in the folder of the spec; the user means where they are themselves.
            # An empty entry, which a colon too many makes, would be the current folder to Python:
            # what lies there, a stranger's checkout perhaps, must not shadow modules.
            folders = (str(Path(each).absolute()) for each in path.split(os.pathsep) if each)
            self._common["PYTHONPATH"] = os.pathsep.join(folders)
        self._common |= {
            RUN_ID_VARIABLE: run_id,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "PYTHONUNBUFFERED": "1",
            # Otherwise ROS leaves a file for each process in the user's home.
            "ROS_LOG_DIR": str(ros_logs or scratch / "ros_logs"),
        }
        self._common.pop("ROS_LOCALHOST_ONLY", None)
        self.segment_bytes = 0
        if plan.transport == "shared_memory" and uses_fast_dds(self._common):
            self.segment_bytes = plan.segment_bytes or segment_bytes(largest_message_bytes)
        if plan.transport != "inherit":
            profile = scratch / "transport.xml"
            profile.write_text(
                transport_profile(plan.transport, largest_message_bytes, plan.segment_bytes)
            )
            # The profile says how processes find each other. With LOCALHOST the middleware would
            # add shared memory of 512 KiB to its transports, and prefer that to UDP: images would
            # go through it in fragments, at ten times the latency.
            self._common["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"
            self._common["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(profile)
            self._common["FASTDDS_DEFAULT_PROFILES_FILE"] = str(profile)

    def for_harness(self, changes: Mapping[str, str] = MappingProxyType({})) -> dict[str, str]:
        """The environment of loader, player and monitor, with that of nodes beside them."""
        return self._common | _HARNESS_ALLOCATOR | self.secrets.in_environment(changes)

    def for_node(self, changes: Mapping[str, str]) -> dict[str, str]:
        """The environment of a process that runs nodes: nothing but what the plan states."""
        return self._common | self.secrets.in_environment(changes)
