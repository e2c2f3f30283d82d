"""Whether a message type begins with a std_msgs/Header, without using ROS."""

from __future__ import annotations

from functools import cache


@cache
def begins_with_header(type_name: str) -> bool | None:
    """Whether the first field of a type is a std_msgs/Header.

    Known for every message of the ROS 2 Jazzy common interfaces, which `rosbags` ships.

    Returns:
        None for a type that is not among them.
    """
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import Stores, get_typestore

    fields = get_typestore(Stores.ROS2_JAZZY).fielddefs.get(type_name)
    if fields is None:
        return None
    entries = fields[1]
    if not entries:
        return False
    kind, detail = entries[0][1]
    return bool(kind == Nodetype.NAME and detail == "std_msgs/msg/Header")
