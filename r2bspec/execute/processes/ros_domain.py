"""Reserving a ROS domain, so that runs on one machine do not discover each other."""

from __future__ import annotations

import contextlib
import random
import socket
from collections.abc import Iterator

from r2bspec.execute.errors import RunError

_MIN_DOMAIN, _MAX_DOMAIN = 1, 100
"""Domains whose UDP ports (7400 + 250 x domain) are outside of the ephemeral range of Linux."""

_PORT_BASE = 32768
"""The convention of ROS's `domain_coordinator`: a process that binds TCP port 32768 + N has
domain N. It also avoids collisions with test suites that use it."""


@contextlib.contextmanager
def reserved_domain() -> Iterator[int]:
    """Reserve a free domain for as long as the context lasts.

    The reservation is a bound port, which the kernel releases when the process exits.

    Raises:
        RunError: all domains are taken.
    """
    candidates = list(range(_MIN_DOMAIN, _MAX_DOMAIN + 1))
    random.shuffle(candidates)
    for domain in candidates:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as guard:
            try:
                guard.bind(("127.0.0.1", _PORT_BASE + domain))
            except OSError:
                continue
            yield domain
            return
    raise RunError(
        f"all ROS domains from {_MIN_DOMAIN} to {_MAX_DOMAIN} are in use on this machine",
        hint="Wait until other runs have finished.",
    )
