"""The processor: cores, frequency governor, clock source and load."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

from r2bspec.doctor.checkup import CheckResult, System, read_text

TOPIC = "processor"

_MIN_CORES = 4
_LOAD_SAMPLE_S = 0.5
_MAX_BUSY_SHARE = 0.1
_MAX_STEAL_SHARE = 0.01
_FAST_CLOCKS = frozenset({"tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"})


def check_processor(
    system: System, sleep: Callable[[float], object] = time.sleep
) -> list[CheckResult]:
    """Cores, quota, governor, clock source and load; takes half a second."""
    found = [_cores(system), _governor(system), _clock(system), _load(system, sleep)]
    return [check for check in found if check is not None]


def _cores(system: System) -> CheckResult:
    cores = len(os.sched_getaffinity(0))
    quota = _quota(system)
    data = {"cores": cores, "quota": quota}
    if quota is not None and quota < cores:
        return CheckResult(
            topic=TOPIC,
            name="cores",
            status="warn",
            found=f"{cores}, limited to the CPU time of {quota:g} by a control group",
            advice="processes are throttled when the quota of a period is used up; increase the "
            "quota of the container, or assign cores instead",
            data=data,
        )
    if cores < _MIN_CORES:
        return CheckResult(
            topic=TOPIC,
            name="cores",
            status="warn",
            found=f"{cores}",
            advice="player, monitor and graph share the cores; compare results of this machine "
            "only with each other",
            data=data,
        )
    return CheckResult(topic=TOPIC, name="cores", status="ok", found=f"{cores}", data=data)


def _quota(system: System) -> float | None:
    """The CPU time that the control group allows, in cores; None for no limit."""
    text = read_text(system.sys / "fs/cgroup/cpu.max")
    words = text.split() if text else []
    if len(words) != 2 or not all(word.isdigit() for word in words):
        return None
    return int(words[0]) / int(words[1])


def _governor(system: System) -> CheckResult:
    files = (system.sys / "devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    governors = sorted({text for file in files if (text := read_text(file))})
    data = {"governors": governors}
    if not governors:
        found = "unknown (usual for virtual machines)"
        return CheckResult(topic=TOPIC, name="governor", status="ok", found=found, data=data)
    if governors == ["performance"]:
        return CheckResult(
            topic=TOPIC, name="governor", status="ok", found="performance", data=data
        )
    return CheckResult(
        topic=TOPIC,
        name="governor",
        status="warn",
        found=", ".join(governors),
        advice="at low rates, latencies include the wake-up of the cores: "
        "sudo cpupower frequency-set -g performance",
        data=data,
    )


def _clock(system: System) -> CheckResult | None:
    folder = system.sys / "devices/system/clocksource/clocksource0"
    source = read_text(folder / "current_clocksource")
    if source is None:
        return None
    fast = source in _FAST_CLOCKS
    return CheckResult(
        topic=TOPIC,
        name="clock",
        status="ok" if fast else "warn",
        found=source,
        advice="" if fast else "reading it is a system call that takes a microsecond or more",
        data={"clocksource": source},
    )


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
    found = f"{busy:.0%} busy"
    if stolen > _MAX_STEAL_SHARE:
        return CheckResult(
            topic=TOPIC,
            name="idle load",
            status="warn",
            found=f"{found}, {stolen:.1%} taken by the host of this virtual machine (steal)",
            advice="the virtual machine does not run during this time; use a dedicated host",
            data=data,
        )
    return CheckResult(
        topic=TOPIC,
        name="idle load",
        status="warn" if busy > _MAX_BUSY_SHARE else "ok",
        found=found,
        advice="stop other programs, which affect the results" if busy > _MAX_BUSY_SHARE else "",
        data=data,
    )


def _ticks(system: System) -> list[int] | None:
    """The total time of all cores in ticks: the first eight fields of ``cpu``."""
    text = read_text(system.proc / "stat")
    words = text.splitlines()[0].split() if text else []
    if len(words) < 9 or words[0] != "cpu":
        return None
    return [int(word) for word in words[1:9]]
