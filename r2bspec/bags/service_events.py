"""The requests in recorded events of service introspection.

Where it is on, a client and a server publish each call on ``SERVICE/_service_event``: the request
sent and received, the response sent and received. The type has the name of the service, with
``_Event`` at its end, and begins with a service_msgs/ServiceEventInfo, in CDR::

    uint8 type | int32 sec, uint32 nanosec | uint8 client[16] | int64 number | uint32 count | ...

The request follows if the count is 1; it is 0 where only metadata was recorded. Client and server
give one call the same number, and different clients: nothing shows that both mean one call. So the
events of one side are played, of the one that recorded more requests.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterable
from typing import Final

from r2bspec.bags.recording import RecordedMessage

SERVICE_EVENT: Final = "/_service_event"
"""The end of the names of these topics."""

_KIND_AT: Final = 4
_COUNT_AT: Final = 44
_SENT, _RECEIVED = 0, 1
"""service_msgs/ServiceEventInfo: REQUEST_SENT of a client, REQUEST_RECEIVED of a server."""


NO_REQUESTS: Final = (
    "has events of calls, and no request: introspection of metadata leaves them out",
    (
        "record it again with the contents: ServiceIntrospectionState.CONTENTS in "
        "'configure_introspection' of the client or the server"
    ),
)
"""What is wrong with a recording without requests, after its name, and what to do."""


def request_side(events: Iterable[RecordedMessage]) -> int | None:
    """Return the kind of the events that have the requests; None if no event has one."""
    kinds = Counter(kind for event in events if (kind := request_kind(event.data)) is not None)
    # A client knows best when it has sent them.
    return max(kinds, key=lambda kind: (kinds[kind], -kind), default=None)


def request_kind(event: bytes) -> int | None:
    """Return the kind of an event that has a request; None for another one, or for other data."""
    if len(event) <= _COUNT_AT + 4 or event[_KIND_AT] not in (_SENT, _RECEIVED):
        return None
    (count,) = struct.unpack_from("<I" if event[1] & 1 else ">I", event, _COUNT_AT)
    return event[_KIND_AT] if count == 1 else None
