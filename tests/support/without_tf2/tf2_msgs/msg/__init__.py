"""TFMessage for publishers and subscriptions of serialised messages."""

from __future__ import annotations

from geometry_msgs.msg import PoseArray


class TFMessage(PoseArray):  # type: ignore[misc]
    """Has a type support to create ends with, and the fields of the real message by name only."""

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """As the real message answers."""
        return {"transforms": "sequence<geometry_msgs/TransformStamped>"}
