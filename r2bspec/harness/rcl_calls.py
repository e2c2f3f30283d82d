"""The two calls of rcl that move serialised messages, without rclpy's copies.

rclpy copies a message into a C++ string to publish it, and into a new `bytes` object to take it.
For an image this takes half of the time of either call. The functions below are rcl's public C API
(``rcl/publisher.h`` and ``rcl/subscription.h``), called on the handles of rclpy; they release the
interpreter lock. If they are not available, the callers use rclpy.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable

HEAD_BYTES = 16
"""The bytes of a taken message that are kept: the encapsulation and the header stamp."""

_TAKE_FAILED = 401
"""RCL_RET_SUBSCRIPTION_TAKE_FAILED: no message was waiting."""


class _Allocator(ctypes.Structure):
    """rcutils_allocator_t: four functions and their state."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("allocate", "free", "move", "zero", "state")]


class _SerializedMessage(ctypes.Structure):
    """rcl_serialized_message_t."""

    _fields_ = [
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    ]


class _MessageInfo(ctypes.Structure):
    """rmw_message_info_t: its first fields, and space for fields that releases of ROS add."""

    _fields_ = [
        ("source_ns", ctypes.c_int64),
        ("received_ns", ctypes.c_int64),
        ("rest", ctypes.c_byte * 240),
    ]


class RclError(Exception):
    """rcl failed to publish or to take a message."""


class _Library:
    """The functions, looked up once, in libraries that rclpy has already loaded."""

    def __init__(self) -> None:
        rcutils, rcl = ctypes.CDLL("librcutils.so"), ctypes.CDLL("librcl.so")
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        self.allocator: _Allocator = rcutils.rcutils_get_default_allocator()
        self.reset_error = rcutils.rcutils_reset_error
        self.publish = rcl.rcl_publish_serialized_message
        self.publish.argtypes = [ctypes.c_void_p] * 3
        self.take = rcl.rcl_take_serialized_message
        self.take.argtypes = [ctypes.c_void_p] * 4


@functools.cache
def _library() -> _Library | None:
    try:
        return _Library()
    except (OSError, AttributeError):
        return None


def publication(publisher: object, message: bytearray) -> Callable[[], None] | None:
    """A function that publishes the content of `message` at the time of the call.

    Args:
        publisher: rclpy's handle of a publisher, which must outlive the function.
        message: serialised; may be changed in place, but can no longer be resized.

    Returns:
        The function, which raises RclError; None if rcl cannot be called.
    """
    library, pointer = _library(), getattr(publisher, "pointer", None)
    if library is None or pointer is None or not message:
        return None
    return _Publication(library, pointer, message)


class _Publication:
    """Publishes one message without a copy, and keeps its memory alive."""

    def __init__(self, library: _Library, pointer: int, message: bytearray) -> None:
        self._library = library
        self._call = library.publish
        self._pointer = pointer
        # The view keeps the bytes alive; rcl receives only their address.
        self._view = (ctypes.c_char * len(message)).from_buffer(message)
        self._message = _SerializedMessage(
            ctypes.addressof(self._view), len(message), len(message), library.allocator
        )
        self._reference = ctypes.byref(self._message)

    def __call__(self) -> None:
        if status := self._call(self._pointer, self._reference, None):
            self._library.reset_error()
            raise RclError(f"publishing a message failed (rcl status {status})")


class MessageTaker:
    """Takes messages into one reused buffer, and returns their first bytes.

    Args:
        subscription: rclpy's handle of a subscription, which must outlive this.

    Raises:
        RclError: rcl cannot be called.
    """

    def __init__(self, subscription: object) -> None:
        library, pointer = _library(), getattr(subscription, "pointer", None)
        if library is None or pointer is None:
            raise RclError("rcl cannot be called")
        self._library = library
        self._call = library.take
        self._pointer = pointer
        # rcl grows it to the largest message; it is freed with the process.
        self._message = _SerializedMessage(None, 0, 0, library.allocator)
        self._info = _MessageInfo()
        self._references = ctypes.byref(self._message), ctypes.byref(self._info)

    def take(self) -> tuple[bytes, int, int] | None:
        """The first bytes of the next message, its size, and its time of arrival (system, ns).

        Returns:
            None if no message is waiting.

        Raises:
            RclError: taking the message failed.
        """
        status = self._call(self._pointer, *self._references, None)
        if status:
            if status == _TAKE_FAILED:
                return None
            self._library.reset_error()
            raise RclError(f"taking a message failed (rcl status {status})")
        size = self._message.length
        head = ctypes.string_at(self._message.buffer, min(size, HEAD_BYTES))
        return head, size, self._info.received_ns
