"""Message classes by their ROS names."""

from __future__ import annotations

import importlib
import re

_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")


def message_type(name: str) -> type:
    """Find the class of a message type such as ``sensor_msgs/msg/Image``.

    Raises:
        ValueError: it is not the name of a message type, or the type is not installed.
    """
    parts = _NAME.fullmatch(name)
    if parts is None:
        raise ValueError(f"{name!r} is not a message type such as sensor_msgs/msg/Image")
    package, message = parts.groups()
    try:
        loaded_class: type = getattr(importlib.import_module(f"{package}.msg"), message)
    except ModuleNotFoundError as missing:
        raise ValueError(f"{name!r}: the package {package} is not installed") from missing
    except AttributeError as missing:
        raise ValueError(f"{name!r}: {package} has no message {message}") from missing
    return loaded_class
