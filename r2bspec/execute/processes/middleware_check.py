"""Whether the middleware (RMW) that the processes of a run load can do what the plan asks for.

`r2bspec validate` says the same of a spec; a plan from a file was not validated here, and the RMW
that is loaded where none is named depends on the installation.
"""

from __future__ import annotations

from collections.abc import Mapping

from r2bspec.execute.errors import MiddlewareError
from r2bspec.middleware.middleware import (
    RMW_VARIABLE,
    TransportKind,
    refuse_transport,
    selected_rmw,
)
from r2bspec.plan.plan import Plan


def check_middleware(plan: Plan, environ: Mapping[str, str]) -> None:
    """See that the transport of a plan can be configured for every process.

    Args:
        plan: says which transport, and what processes have in their own environment.
        environ: what r2bspec runs in, of which the processes inherit the selection.

    Raises:
        MiddlewareError: it cannot.
    """
    _refuse(plan.transport, selected_rmw(environ), RMW_VARIABLE)
    for process in plan.processes:
        if process.env.get(RMW_VARIABLE):
            _refuse(plan.transport, selected_rmw(process.env), f"{RMW_VARIABLE} of {process.name}")


def check_loaded_rmw(kind: TransportKind, rmw: str) -> None:
    """The same for the implementation that a process says it has loaded.

    Raises:
        MiddlewareError: the transport cannot be configured for it.
    """
    _refuse(kind, rmw, "this installation")


def _refuse(kind: TransportKind, rmw: str, selected_by: str) -> None:
    refusal = refuse_transport(kind, rmw)
    if refusal is not None:
        from r2bspec.check.rules.transport_unsupported_by_middleware import RULE

        way_out = f"{refusal.help[0].upper()}{refusal.help[1:]}."
        raise MiddlewareError(
            f"{refusal.message}, which {selected_by} selects", hint=way_out, code=RULE.code
        )
