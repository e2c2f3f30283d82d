"""The checks of this machine, and of what is installed.

For the processor: cores, frequency governor and load. For shared memory: room for the segments of a
run. For the network: what messages over UDP need. For ROS 2: its distribution, middleware and
message packages. Modules are imported in a new interpreter (`r2bspec.doctor.import_probe`).
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from r2bspec.datasets.catalogue import CACHE_KIND
from r2bspec.doctor.checkup import CheckResult, Status, System, advised, read_int, read_text
from r2bspec.doctor.leftovers import check_leftovers
from r2bspec.extras import install_command
from r2bspec.judge.measure.units import show
from r2bspec.middleware.middleware import (
    DISCOVERY_VARIABLES,
    RMW_VARIABLE,
    MessageTransport,
    Middleware,
    middleware_named,
    middleware_of,
    refuse_transport,
    selected_rmw,
)
from r2bspec.native.build import BuildError, harness_program
from r2bspec.plan.this_machine import cpu_quota
from r2bspec.safe_io.cache_folder import cache_path


def examine(system: System) -> Iterator[CheckResult]:
    """Run all checks, and yield each result immediately."""
    # The processor first, because the processes that other checks start add to its load.
    for check in (
        check_processor,
        check_shared_memory,
        check_sockets,
        check_ros,
        check_native,
        check_vision,
        check_datasets,
        check_leftovers,
    ):
        yield from check(system)


_PROCESSOR = "processor"

_MIN_CORES = 4
_LOAD_SAMPLE_S = 0.5
_MAX_BUSY_SHARE = 0.1
_MAX_STEAL_SHARE = 0.01


def check_processor(
    system: System, sleep: Callable[[float], object] = time.sleep
) -> list[CheckResult]:
    """Check cores, quota, governor and load; takes half a second."""
    return [_cores(system), _governor(system), *_load(system, sleep)]


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
    text = ", ".join(governors) or "unknown (usual for virtual machines)"
    advice = (
        "at low rates, latencies include the wake-up of the cores: "
        "sudo cpupower frequency-set -g performance"
    )
    saving = bool(governors) and governors != ["performance"]
    return advised(_PROCESSOR, "governor", text, advice if saving else "", {"governors": governors})


def _load(system: System, sleep: Callable[[float], object]) -> list[CheckResult]:
    before = _ticks(system)
    sleep(_LOAD_SAMPLE_S)
    after = _ticks(system)
    if before is None or after is None:
        return []
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
    return [advised(_PROCESSOR, "idle load", text, advice, data)]


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


def check_sockets(system: System) -> list[CheckResult]:
    """Check the largest socket buffers."""
    middleware = middleware_of(system.environ)
    requested = middleware.socket_buffers
    return [
        _buffer(system, middleware.name, "receive", "rmem_max", requested.receive),
        _buffer(system, middleware.name, "send", "wmem_max", requested.send),
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


_DATASETS = "datasets"

_MIN_FREE_BYTES = 4 << 30
"""The size of a few seconds of all topics of the largest synthetic dataset."""


def check_datasets(_system: System, cache: Path | None = None) -> list[CheckResult]:
    """Check the disk of the cache of synthetic datasets."""
    folder = cache or cache_path(CACHE_KIND)
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
    text = f"{show(free, 'B')} free; {folder}"
    return [advised(_DATASETS, "cache", text, advice, data)]


_ROS = "ROS 2"

_MIDDLEWARE = "rclpy:get_rmw_implementation_identifier"
_MAX_IMPORT_S = 2.0
_MESSAGES = ("std_msgs", "sensor_msgs", "geometry_msgs", "nav_msgs", "stereo_msgs")
_WHEEL = re.compile(r"ros-(?:(?P<distribution>[a-z]+)-)?rclpy")
_RCL_PREFIX = re.compile(r"^(?:\[[^\]]*\] ?){3}: ")
_RCL_PLACE = re.compile(r", at \S+:\d+$")
_INSTALL = f"source a ROS 2 installation, or {install_command('ros')}"


def check_ros(system: System) -> list[CheckResult]:
    """Check the visible distributions, rclpy, the middleware and the message packages."""
    import_result = probe_imports(system, _MIDDLEWARE)[_MIDDLEWARE]
    checks = [_distributions(system)]
    if "error" in import_result:
        advice = _advice(system, import_result["error"])
        said = _RCL_PLACE.sub("", _RCL_PREFIX.sub("", import_result["error"]))
        return [*checks, advised(_ROS, "rclpy", said, advice, otherwise="problem")]
    return [
        *checks,
        _client_library(import_result["seconds"], import_result["file"]),
        _middleware(system, import_result["said"]),
        _messages(system),
    ]


def _advice(system: System, error: str) -> str:
    """Return what to do about an error of importing rclpy or loading its middleware."""
    if "ModuleNotFoundError" in error:
        return _INSTALL
    selected = system.environ.get(RMW_VARIABLE, "")
    if selected and "RMW implementation" in error:
        return f"{selected} is not installed: install it, or unset {RMW_VARIABLE}"
    return "see the error above"


def _distributions(system: System) -> CheckResult:
    """Sourced prefixes first, since they win on PYTHONPATH; then wheels of this interpreter."""
    prefixes = _paths(system.environ.get("AMENT_PREFIX_PATH", ""))
    wheels = sorted(
        {
            f"{match['distribution'] or 'unnamed'} {distribution.version}"
            for distribution in importlib.metadata.distributions()
            if (match := _WHEEL.fullmatch((distribution.metadata["Name"] or "").lower()))
        }
    )
    named = [wheel for wheel in wheels if not wheel.startswith("unnamed ")] or wheels
    sourced = system.environ.get("ROS_DISTRO", "") if prefixes else ""
    parts = []
    if sourced:
        more = f" and {len(prefixes) - 1} more" if len(prefixes) > 1 else ""
        parts.append(f"{sourced} sourced from {prefixes[-1]}{more}")
    parts += [f"{package} as wheels" for package in named]
    # The metapackage of the wheels names the same rclpy again; only a sourced one competes.
    mixed = bool(sourced) and any(not package.startswith(sourced) for package in named)
    advice = "" if parts else _INSTALL
    if mixed:
        advice = "two distributions are mixed: source none, or leave the wheels out"
    return advised(
        _ROS,
        "distributions",
        ", ".join(parts) or "none that is sourced or installed as wheels",
        advice,
        {"sourced": sourced, "prefixes": prefixes, "wheels": wheels},
    )


def _client_library(seconds: float, file: str) -> CheckResult:
    slow = seconds > _MAX_IMPORT_S
    text = f"imported in {show(seconds, 's')} from {Path(file).parent}"
    advice = "every process of a run waits for this; a network file system?" if slow else ""
    return advised(_ROS, "rclpy", text, advice, {"import_s": seconds, "file": file})


def _middleware(system: System, used: str) -> CheckResult:
    here = sorted(
        {
            path.name
            for prefix in _paths(system.environ.get("AMENT_PREFIX_PATH", ""))
            for path in Path(prefix).glob("share/ament_index/resource_index/rmw_typesupport/*")
        }
        | {used}
    )
    others = [name for name in here if name != used]
    advice = [*_refused_transport(system, used), *_overridden_discovery(system, used)]
    text = used + (f" (also here: {', '.join(others)})" if others else "")
    return advised(_ROS, "middleware", text, "; ".join(advice), {"used": used, "here": here})


def _refused_transport(system: System, used: str) -> Iterator[str]:
    """Yield why runs with the default transport are refused, or configure another one."""
    refusal = refuse_transport("shared_memory", used)
    if refusal is not None:
        yield f"the default {refusal.message}: {refusal.help}"
    selected = selected_rmw(system.environ)
    if selected != used:
        yield f"runs configure {selected}: set {RMW_VARIABLE}={used}"


def _overridden_discovery(system: System, used: str) -> Iterator[str]:
    for name in middleware_named(used).override_variables:
        if system.environ.get(name):
            yield f"{name} is set, and can let nodes of a run discover those of other hosts"
    if unused := [name for name in DISCOVERY_VARIABLES if system.environ.get(name)]:
        yield (
            f"{', '.join(unused)}: not passed on to nodes of a run, unless its spec names it under "
            "'environment'"
        )


def _messages(system: System) -> CheckResult:
    imports = probe_imports(system, *(f"{name}.msg" for name in _MESSAGES))
    missing = [name for name in _MESSAGES if "error" in imports[f"{name}.msg"]]
    there = [name for name in _MESSAGES if name not in missing]
    named = ", ".join(there) + (f"; not here: {', '.join(missing)}" if missing else "")
    advice = f"specs that use them cannot run; {_INSTALL}" if missing else ""
    return advised(_ROS, "messages", named, advice, {"missing": missing})


def _paths(text: str) -> list[str]:
    return [path for path in text.split(":") if path]


_TIMEOUT_S = 60.0


def probe_imports(system: System, *names: str) -> dict[str, dict[str, Any]]:
    """Return the results of `r2bspec.doctor.import_probe` for these modules.

    A timeout is an error.
    """
    command = [system.python, "-P", "-m", "r2bspec.doctor.import_probe", *names]
    try:
        done = subprocess.run(
            command,
            env=dict(system.environ),
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return {name: {"error": f"not imported within {_TIMEOUT_S:g} s"} for name in names}
    except OSError as error:
        return {name: {"error": str(error)} for name in names}
    try:
        results: dict[str, dict[str, Any]] = json.loads(done.stdout)
    except ValueError:
        # A module can end the interpreter, as rclpy does where its middleware is not installed.
        said = done.stderr.strip().splitlines() or [f"it ended with status {done.returncode}"]
        return {name: {"error": said[-1]} for name in names}
    return results


_OPENCV = "OpenCV"


def check_vision(system: System) -> list[CheckResult]:
    """Check whether OpenCV can be imported. Only the reference nodes need it."""
    import_result = probe_imports(system, "cv2")["cv2"]
    if "error" in import_result:
        advice = f"the reference nodes for images need it: {install_command('vision')}"
        return [advised(_OPENCV, "version", import_result["error"], advice)]
    return [advised(_OPENCV, "version", import_result["version"], "", import_result)]


_NATIVE = "native harness"


def check_native(system: System) -> list[CheckResult]:
    """Build the program of player and monitor, if necessary; takes a second."""
    try:
        program = harness_program(system.environ)
    except BuildError as error:
        problem = str(error).splitlines()[0]
        return [CheckResult(_NATIVE, "build", "problem", problem, error.hint)]
    # A program that is not kept has no path, and is known by its descriptor.
    path = str(program.resolve())
    return [advised(_NATIVE, "build", path, "", {"program": path})]
