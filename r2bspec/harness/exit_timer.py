"""Leaving the middleware, and ending all the same should it not let go.

Some middleware can hang while it is left (`Middleware.may_hang_on_exit`), inside a native call that
holds the interpreter's lock: no thread of Python would get a turn to end the process then. A timer
of POSIX does not need one.
"""

from __future__ import annotations

import contextlib
import ctypes
import time

_SIGEV_THREAD = 2


class _Timespec(ctypes.Structure):
    """struct timespec."""

    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


class _Itimerspec(ctypes.Structure):
    """struct itimerspec."""

    _fields_ = [("interval", _Timespec), ("value", _Timespec)]


class _Sigevent(ctypes.Structure):
    """struct sigevent, which is 64 bytes long: here, a function that a new thread calls."""

    _fields_ = [
        ("value", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("rest", ctypes.c_byte * 40),
    ]


def start_exit_timer(seconds: float, status: int) -> None:
    """End this process with a status when some time has passed, whatever it is doing then.

    Where the C library has no such timers nothing happens; the controller then ends the process.
    """
    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        event = _Sigevent(
            value=status,
            notify=_SIGEV_THREAD,
            function=ctypes.cast(library._exit, ctypes.c_void_p).value,
        )
        timer = ctypes.c_void_p()
        if library.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
            return
        whole, rest = divmod(seconds, 1.0)
        when = _Itimerspec(value=_Timespec(int(whole), int(rest * 1e9)))
        library.timer_settime(timer, 0, ctypes.byref(when), None)
