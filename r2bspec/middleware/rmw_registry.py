"""Which middleware (RMW) is selected, and which are known.

Every module of this package that has a MIDDLEWARE is about one. They are imported when the first
question is asked.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import NamedTuple

import r2bspec.middleware
from r2bspec.middleware.middleware import Middleware, TransportKind, UnknownMiddleware

RMW_VARIABLE = "RMW_IMPLEMENTATION"

_DEFAULT = "rmw_fastrtps_cpp"
"""What ROS 2 Jazzy takes where the variable is not set, or empty."""


class TransportRefusal(NamedTuple):
    """Why a transport cannot be had with the middleware that is selected, and the ways out."""

    message: str
    help: str


@cache
def known_middlewares() -> tuple[Middleware, ...]:
    """Every RMW that has a module here, in the order of their names."""
    package = r2bspec.middleware
    modules = [
        import_module(each.name)
        for each in pkgutil.iter_modules(package.__path__, f"{package.__name__}.")
        if each.name != __name__
    ]
    found: list[Middleware] = [each.MIDDLEWARE for each in modules if hasattr(each, "MIDDLEWARE")]
    return tuple(sorted(found, key=lambda each: each.name))


@cache
def middleware_named(rmw: str) -> Middleware:
    """The RMW of an implementation, such as ``rmw_cyclonedds_cpp``."""
    for each in known_middlewares():
        if rmw in each.implementations:
            return each
    return UnknownMiddleware(rmw)


def selected_rmw(environ: Mapping[str, str]) -> str:
    """The implementation that processes with this environment load."""
    return environ.get(RMW_VARIABLE) or _DEFAULT


def middleware_of(environ: Mapping[str, str]) -> Middleware:
    """The RMW that processes with this environment load."""
    return middleware_named(selected_rmw(environ))


def inherited_variables() -> tuple[str, ...]:
    """Patterns of the variables by which users configure any RMW."""
    unknown = UnknownMiddleware.variables
    return tuple(name for each in known_middlewares() for name in each.variables) + unknown


def refuse_transport(kind: TransportKind, rmw: str) -> TransportRefusal | None:
    """Why an implementation cannot be configured for a transport; None if it can."""
    middleware = middleware_named(rmw)
    if kind in middleware.transports:
        return None
    others = " or ".join(
        rmw
        for each in known_middlewares()
        if kind in each.transports
        for rmw in each.implementations[:1]
    )
    return TransportRefusal(
        f"'transport: {kind}' cannot be configured with {rmw}",
        f"write 'transport: inherit', which leaves the transport to {middleware.name}; or unset "
        f"{RMW_VARIABLE}, or set it to {others}",
    )
