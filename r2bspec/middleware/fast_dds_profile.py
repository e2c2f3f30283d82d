"""The XML profile by which Fast DDS is configured for a transport, and the size of its segments."""

from __future__ import annotations

_SEGMENT_MESSAGES = 24
"""How many of the largest message a shared-memory segment holds: a writer's queue of ten, the
same again on its way through readers, and room for small ones."""

_SEGMENT_MINIMUM = 8 << 20
_SEGMENT_MAXIMUM = 4095 << 20
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

_PARTICIPANTS = 64
"""How many processes of a domain find each other without multicast; each is asked by its port."""

_UDP = f"""\
      <transport_descriptor>
        <transport_id>udp</transport_id>
        <type>UDPv4</type>
        <sendBufferSize>{SOCKET_BUFFER_BYTES}</sendBufferSize>
        <receiveBufferSize>{SOCKET_BUFFER_BYTES}</receiveBufferSize>
        <maxInitialPeersRange>{_PARTICIPANTS}</maxInitialPeersRange>
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
    """The size of a shared-memory segment for messages up to this size, in bytes."""
    wanted = _SEGMENT_MESSAGES * (largest_message_bytes + 4096)
    return min(max(_SEGMENT_MINIMUM, wanted), _SEGMENT_MAXIMUM)


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
    segment = segment or default_segment_bytes(largest_message_bytes)
    shared = _SHARED_MEMORY.format(segment=segment, message=segment // 2)
    return _PROFILE.format(
        transports=f"{shared}\n{_UDP}",
        names="<transport_id>shm</transport_id><transport_id>udp</transport_id>",
    )
