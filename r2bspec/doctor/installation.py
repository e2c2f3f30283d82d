"""What is installed: ROS 2, its middleware and message packages, OpenCV, and a compiler.

Modules are imported in a new interpreter (`r2bspec.doctor.import_probe`).
"""

from __future__ import annotations

import importlib.metadata
import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from r2bspec.doctor.checkup import CheckResult, System, advised
from r2bspec.extras import install_command
from r2bspec.judge.measure.units import show
from r2bspec.middleware.middleware import (
    DISCOVERY_VARIABLES,
    RMW_VARIABLE,
    middleware_named,
    refuse_transport,
    selected_rmw,
)
from r2bspec.native.build import BuildError, harness_program

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
    problem = str(program.resolve())
    return [advised(_NATIVE, "build", problem, "", {"program": problem})]
