"""Classes of other packages that get a node and make its topics: what each of them makes.

A node that passes itself to any other code may have topics that its own text does not say.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import msgspec

_TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"


class NodeHelper(msgspec.Struct, frozen=True):
    """A class whose constructor gets the node.

    Attributes:
        node: the position of the node among the arguments; it may also be called ``node``.
        publishes: the types of the topics that it publishes for the node, by their names.
        subscribes: likewise.
        makes_subscription: whether its arguments after the node are those of a subscription.
        names_action: whether its third argument is the name of an action; the type comes first.
        answers: whether it is the server of this action.
    """

    node: int = 0
    publishes: Mapping[str, str] = msgspec.field(default_factory=dict)
    subscribes: Mapping[str, str] = msgspec.field(default_factory=dict)
    makes_subscription: bool = False
    names_action: bool = False
    answers: bool = False


_LISTENER = NodeHelper(1, subscribes={"/tf": _TRANSFORMS, "/tf_static": _TRANSFORMS})
_BROADCASTER = NodeHelper(publishes={"/tf": _TRANSFORMS})
_STATIC_BROADCASTER = NodeHelper(publishes={"/tf_static": _TRANSFORMS})
_ACTION_CLIENT = NodeHelper(names_action=True)
_ACTION_SERVER = NodeHelper(names_action=True, answers=True)

NODE_HELPERS: Final[Mapping[str, NodeHelper]] = {
    "message_filters.Subscriber": NodeHelper(makes_subscription=True),
    "rclpy.action.ActionClient": _ACTION_CLIENT,
    "rclpy.action.ActionServer": _ACTION_SERVER,
    "rclpy.action.client.ActionClient": _ACTION_CLIENT,
    "rclpy.action.server.ActionServer": _ACTION_SERVER,
    "tf2_ros.Buffer": NodeHelper(1),
    "tf2_ros.StaticTransformBroadcaster": _STATIC_BROADCASTER,
    "tf2_ros.TransformBroadcaster": _BROADCASTER,
    "tf2_ros.TransformListener": _LISTENER,
    "tf2_ros.buffer.Buffer": NodeHelper(1),
    "tf2_ros.static_transform_broadcaster.StaticTransformBroadcaster": _STATIC_BROADCASTER,
    "tf2_ros.transform_broadcaster.TransformBroadcaster": _BROADCASTER,
    "tf2_ros.transform_listener.TransformListener": _LISTENER,
}
"""Helpers by their full names."""

CALLBACK_TAKERS: Final = frozenset({"functools.partial", "threading.Thread", "threading.Timer"})
"""Functions that get a method of a node only to call it."""

CALLBACK_METHODS: Final = frozenset({"add_done_callback", "registerCallback"})
"""Methods of other objects that do."""
