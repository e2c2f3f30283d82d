"""Socket buffers and the loopback device: what messages over UDP need."""

from __future__ import annotations

from r2bspec.doctor.checkup import CheckResult, System, read_int, read_text
from r2bspec.measure.units import show
from r2bspec.middleware.rmw_registry import middleware_of

TOPIC = "network"

_IFF_UP = 0x1


def check_sockets(system: System) -> list[CheckResult]:
    """The largest socket buffers that the kernel grants, and whether loopback is up."""
    middleware = middleware_of(system.environ)
    requested = middleware.socket_buffers
    return [
        _buffer(system, middleware.name, "receive", "rmem_max", requested.receive),
        _buffer(system, middleware.name, "send", "wmem_max", requested.send),
        *_loopback(system),
    ]


def _buffer(
    system: System, middleware: str, direction: str, name: str, requested: int
) -> CheckResult:
    limit = read_int(system.proc / "sys/net/core" / name)
    title = f"{direction} buffers"
    if limit is None:
        return CheckResult(topic=TOPIC, name=title, status="ok", found="not told by this kernel")
    data = {f"net.core.{name}": limit, "wanted": requested}
    if limit >= requested:
        return CheckResult(
            topic=TOPIC, name=title, status="ok", found=f"up to {show(limit, 'B')}", data=data
        )
    return CheckResult(
        topic=TOPIC,
        name=title,
        status="warn",
        found=f"at most {show(limit, 'B')}, while {middleware} asks for {show(requested, 'B')}",
        advice="large messages over UDP will be lost and sent again; "
        f"sudo sysctl -w net.core.{name}={requested}",
        data=data,
    )


def _loopback(system: System) -> list[CheckResult]:
    flags = read_text(system.sys / "class/net/lo/flags")
    if flags is None or int(flags, 16) & _IFF_UP:
        return []
    return [
        CheckResult(
            topic=TOPIC,
            name="loopback",
            status="problem",
            found="the device lo is down",
            advice="discovery runs over it; sudo ip link set lo up",
        )
    ]
