"""Cyclone DDS, which rmw_cyclonedds_cpp uses.

With a discovery range of LOCALHOST the RMW turns multicast off and names this host as the only
peer; at most 33 processes of a domain then find each other. It appends CYCLONEDDS_URI to that, so
the user's settings have priority, and nothing is added to it here. Cyclone DDS itself uses no
shared memory; Iceoryx, with which it can be built, has files of its own that its daemon removes.
"""

from __future__ import annotations

from r2bspec.middleware.middleware import Middleware, SocketBuffers


class CycloneDds(Middleware):
    """See the module."""

    name = "Cyclone DDS"
    implementations = ("rmw_cyclonedds_cpp",)
    variables = ("CYCLONEDDS_*",)
    override_variables = ("CYCLONEDDS_URI",)
    distributions = ("cyclonedds", "rmw-cyclonedds-cpp")
    # Its default; for sending it takes that of the kernel.
    socket_buffers = SocketBuffers(receive=1 << 20)


MIDDLEWARE = CycloneDds()
