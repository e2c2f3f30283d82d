"""The machine: processor, shared memory, socket buffers, and the disk of datasets.

For the processor: cores, frequency governor, clock source and load. For shared memory: room for the
segments of a run. For the network: what messages over UDP need. For the cache of datasets: its
size, and the free space of its disk.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

from r2bspec.datasets.catalogue import CACHE_KIND
from r2bspec.doctor.checkup import CheckResult, Status, System, advised, read_int, read_text
from r2bspec.ipc.network import why_not_emulated
from r2bspec.judge.measure.units import show
from r2bspec.middleware.middleware import MessageTransport, Middleware, middleware_of
from r2bspec.plan.this_machine import cpu_quota
from r2bspec.safe_io.cache_folder import cache_path

_PROCESSOR = "processor"

_MIN_CORES = 4
_LOAD_SAMPLE_S = 0.5
_MAX_BUSY_SHARE = 0.1
_MAX_STEAL_SHARE = 0.01
_FAST_CLOCKS = frozenset({"tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"})


def check_processor(
    system: System, sleep: Callable[[float], object] = time.sleep
) -> list[CheckResult]:
    """Check cores, quota, governor, clock source and load; takes half a second."""
    checks = [_cores(system), _governor(system), _clock(system), _load(system, sleep)]
    return [check for check in checks if check is not None]


def _cores(system: System) -> CheckResult:
    cores = len(os.sched_getaffinity(0))
    quota = cpu_quota(system.proc, system.sys)
    text, advice = f"{cores}", ""
    if quota is not None and quota < cores:
        text = f"{cores}, limited to the CPU time of {quota:g} by a control group"
        advice = (
            "processes are throttled when the quota of a period is used up; increase the "
            "quota of the container, or assign cores instead"
        )
    elif cores < _MIN_CORES:
        advice = (
            "player, monitor and graph share the cores; compare results of this machine "
            "only with each other"
        )
    return advised(_PROCESSOR, "cores", text, advice, {"cores": cores, "quota": quota})


def _governor(system: System) -> CheckResult:
    files = (system.sys / "devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    governors = sorted({text for file in files if (text := read_text(file))})
    requirement_text = ", ".join(governors) or "unknown (usual for virtual machines)"
    advice = (
        "at low rates, latencies include the wake-up of the cores: "
        "sudo cpupower frequency-set -g performance"
    )
    saving = bool(governors) and governors != ["performance"]
    return advised(
        _PROCESSOR, "governor", requirement_text, advice if saving else "", {"governors": governors}
    )


def _clock(system: System) -> CheckResult | None:
    folder = system.sys / "devices/system/clocksource/clocksource0"
    source = read_text(folder / "current_clocksource")
    if source is None:
        return None
    slow = source not in _FAST_CLOCKS
    advice = "reading it is a system call that takes a microsecond or more" if slow else ""
    return advised(_PROCESSOR, "clock", source, advice, {"clocksource": source})


def _load(system: System, sleep: Callable[[float], object]) -> CheckResult | None:
    before = _ticks(system)
    sleep(_LOAD_SAMPLE_S)
    after = _ticks(system)
    if before is None or after is None:
        return None
    spent = [late - early for early, late in zip(before, after, strict=True)]
    total = max(sum(spent), 1)
    # user nice system idle iowait irq softirq steal
    busy, stolen = 1 - (spent[3] + spent[4]) / total, spent[7] / total
    data = {"busy": round(busy, 4), "stolen": round(stolen, 4)}
    text, advice = f"{busy:.0%} busy", ""
    if stolen > _MAX_STEAL_SHARE:
        text += f", {stolen:.1%} taken by the host of this virtual machine (steal)"
        advice = "the virtual machine does not run during this time; use a dedicated host"
    elif busy > _MAX_BUSY_SHARE:
        advice = "stop other programs, which affect the results"
    return advised(_PROCESSOR, "idle load", text, advice, data)


def _ticks(system: System) -> list[int] | None:
    """Return the total time of all cores in ticks: the first eight fields of ``cpu``."""
    text = read_text(system.proc / "stat")
    words = text.splitlines()[0].split() if text else []
    if len(words) < 9 or words[0] != "cpu":
        return None
    return [int(word) for word in words[1:9]]


_SHARED_MEMORY = "shared memory"

_PARTICIPANTS = 4
"""Player, monitor and two nodes: each has a segment of its own."""

_SIZES = (("1280x720 rgb8", 1280 * 720 * 3), ("1920x1200 rgb8", 1920 * 1200 * 3))


def check_shared_memory(system: System) -> list[CheckResult]:
    """Check the free shared memory, and for how many processes with images it suffices."""
    middleware = middleware_of(system.environ)
    if not middleware.uses_shared_memory:
        text = f"not used by a run with {middleware.name}"
        return [advised(_SHARED_MEMORY, "size", text, "")]
    try:
        usage = shutil.disk_usage(system.shared_memory)
    except OSError as error:
        text = f"{system.shared_memory}: {error.strerror or error}"
        advice = "mount a tmpfs there, or state transport: udp"
        return [advised(_SHARED_MEMORY, "size", text, advice, otherwise="problem")]
    room = {name: usage.free // _segment_bytes(middleware, size) for name, size in _SIZES}
    status: Status = "ok" if min(room.values()) >= _PARTICIPANTS else "warn"
    if usage.free < _PARTICIPANTS * _segment_bytes(middleware, 0):
        status = "problem"
    room_text = ", ".join(f"{_processes(count)} at {name}" for name, count in room.items())
    text = f"{show(usage.free, 'B')} free of {show(usage.total, 'B')}: room for {room_text}"
    advice = (
        f"sudo mount -o remount,size=2G {system.shared_memory} (in a container: "
        "--shm-size=2g), or state transport: udp"
    )
    data = {"free_bytes": usage.free, "total_bytes": usage.total, "processes": room}
    advice = "" if status == "ok" else advice
    return [advised(_SHARED_MEMORY, "size", text, advice, data, otherwise=status)]


def _segment_bytes(middleware: Middleware, message_bytes: int) -> int:
    return middleware.segment_bytes(MessageTransport("shared_memory", message_bytes))


def _processes(count: int) -> str:
    return "1 process" if count == 1 else f"{count} processes"


_NETWORK = "network"

_IFF_UP = 0x1


def check_sockets(system: System) -> list[CheckResult]:
    """Check the largest socket buffers, loopback, and whether a `network` can be emulated."""
    middleware = middleware_of(system.environ)
    requested = middleware.socket_buffers
    return [
        _buffer(system, middleware.name, "receive", "rmem_max", requested.receive),
        _buffer(system, middleware.name, "send", "wmem_max", requested.send),
        *_loopback(system),
        _emulation(),
    ]


def _buffer(
    system: System, middleware: str, direction: str, name: str, requested: int
) -> CheckResult:
    limit = read_int(system.proc / "sys/net/core" / name)
    title = f"{direction} buffers"
    if limit is None:
        return advised(_NETWORK, title, "not reported by this kernel", "")
    data = {f"net.core.{name}": limit, "wanted": requested}
    if limit >= requested:
        return advised(_NETWORK, title, f"up to {show(limit, 'B')}", "", data)
    text = f"at most {show(limit, 'B')}, while {middleware} asks for {show(requested, 'B')}"
    advice = (
        "large messages over UDP will be lost and sent again; "
        f"sudo sysctl -w net.core.{name}={requested}"
    )
    return advised(_NETWORK, title, text, advice, data)


def _loopback(system: System) -> list[CheckResult]:
    flags = read_text(system.sys / "class/net/lo/flags")
    if flags is None or int(flags, 16) & _IFF_UP:
        return []
    text, advice = "the device lo is down", "discovery runs over it; sudo ip link set lo up"
    return [advised(_NETWORK, "loopback", text, advice, otherwise="problem")]


def _emulation() -> CheckResult:
    # Few specs have a network: that it is missing is no fault of a machine.
    refusal = why_not_emulated()
    text = "available" if refusal is None else f"{refusal}. {refusal.hint}"
    return advised(_NETWORK, "emulation", text, "", {"available": refusal is None})


_DATASETS = "datasets"

_MIN_FREE_BYTES = 4 << 30
"""The size of a few seconds of all topics of the largest synthetic dataset."""


def check_datasets(system: System, cache: Path | None = None) -> list[CheckResult]:
    """Check the cache, and the folder of recorded datasets if R2B_DATASETS is set."""
    checks = [_cache(cache or cache_path(CACHE_KIND))]
    named = system.environ.get("R2B_DATASETS")
    if named and not Path(named).is_dir():
        text = f"R2B_DATASETS is {named}, which is not a folder"
        advice = "correct it, or unset it to use synthetic datasets"
        checks.append(advised(_DATASETS, "recorded", text, advice, otherwise="problem"))
    return checks


def _cache(folder: Path) -> CheckResult:
    # The nearest parent that exists is on the same disk.
    existing = next(place for place in (folder, *folder.parents) if place.exists())
    free = shutil.disk_usage(existing).free
    advice = (
        "remove synthetic datasets, which are created again when needed, "
        "or select another disk with XDG_CACHE_HOME"
        if free < _MIN_FREE_BYTES
        else ""
    )
    data = {"path": str(folder), "free_bytes": free}
    return advised(_DATASETS, "cache", f"{show(free, 'B')} free; {folder}", advice, data)
