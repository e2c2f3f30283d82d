"""What a spec cannot do on a host whose owner allows neither commands nor Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from ament_packages import install_package
from r2bspec.fleet.errors import NotAllowedError
from r2bspec.fleet.permissions import check_allowed
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.command_lines import HARNESS_ARGV, INCLUDED_LAUNCH
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.plan import AfterReadyPlan, Plan
from ros_runs import relay_spec

OWN = {"python": "r2bspec.nodes.RelayNode"}
LAUNCH_LINE = ["ros2", "launch", INCLUDED_LAUNCH]
LAUNCH_END = ["namespace:=/", "remappings:={}", "arguments:={}"]


def plan_of(node: dict[str, Any], **parts: Any) -> Plan:
    loaded = load_spec(yaml.safe_dump(relay_spec(graph={"nodes": {"own": node}}, **parts)))
    assert loaded.spec is not None, loaded.diagnostics
    return compile_plan(loaded.spec, None)


def needs(plan: Plan) -> set[str]:
    """The permissions without which a plan is refused."""
    both = {"commands", "python"}
    check_allowed(plan, tuple(both), "here")
    return {permission for permission in both if _is_refused(plan, both - {permission}, permission)}


def _is_refused(plan: Plan, allows: set[str], permission: str) -> bool:
    try:
        check_allowed(plan, tuple(allows), "here")
    except NotAllowedError as error:
        return f"--allow-{permission}" in str(error) and error.code == "R2B685"
    return False


@pytest.mark.parametrize(
    ("node", "permission"),
    [
        ({"command": ["./tool.sh"]}, "commands"),
        ({"command": ["ros2", "launch", "./evil.launch.py"]}, "commands"),
        ({"command": ["ros2", "launch", "demo", "x.launch.py"]}, "commands"),
        ({**OWN, "prefix": ["taskset"]}, "commands"),
        ({"package": "demo", "executable": "talker", "arguments": ["--loud"]}, "commands"),
        ({"launch": {"package": "demo", "file": "x.py", "arguments": {"a": "./b"}}}, "commands"),
        ({"package": "demo", "executable": "talker", "prefix": ["./tool.sh"]}, "commands"),
        ({"python": "./own.py:Own"}, "python"),
        ({"python": "pytest.main"}, "python"),
        ({"launch": {"path": "./x.launch.py"}}, "python"),
        ({"launch": {"package": "rclpy", "file": "../../../..//x/evil.launch.py"}}, "python"),
        ({"launch": {"package": "rclpy", "file": "/x/evil.launch.py"}}, "python"),
    ],
)
def test_what_a_spec_brings_along_needs_a_permission(node: dict[str, Any], permission: str) -> None:
    assert needs(plan_of(node)) == {permission}


@pytest.mark.parametrize(
    "node",
    [
        OWN,
        {
            "package": "demo",
            "executable": "talker",
            "parameters": {"loud": True},
            "remappings": {"in": "out"},
        },
        {"package": "demo", "plugin": "demo::Talker"},
        {"launch": {"package": "demo", "file": "x.launch.py"}},
        {"launch": {"package": "demo", "file": "launch/x.launch.py"}, "remappings": {"in": "out"}},
        {**OWN, "env": {"OMP_NUM_THREADS": "1"}},
    ],
)
def test_what_is_installed_needs_none(node: dict[str, Any]) -> None:
    check_allowed(plan_of(node), (), "here")


@pytest.mark.parametrize(
    "name",
    [
        *("HOME", "PATH", "PYTHONUSERBASE", "PYTHONPATH", "PYTHONSTARTUP", "OPENSSL_CONF"),
        *("TMPDIR", "BASH_ENV", "ENV", "GLIBC_TUNABLES", "AMENT_PREFIX_PATH", "VIRTUAL_ENV", "TZ"),
        *("RMW_IMPLEMENTATION", "QT_QPA_PLATFORM"),
        *("OPENSSL_MODULES", "GCONV_PATH", "LOCPATH", "LD_PRELOAD", "LD_LIBRARY_PATH", "LD_AUDIT"),
        *("RCUTILS_LOGGING_IMPLEMENTATION", "RCL_LOGGING_IMPLEMENTATION", "CYCLONEDDS_URI"),
        *("FASTRTPS_DEFAULT_PROFILES_FILE", "QT_PLUGIN_PATH", "XDG_CONFIG_HOME", "R2BSPEC_X", "X"),
    ],
)
def test_variables_are_an_allow_list(name: str) -> None:
    assert needs(plan_of({**OWN, "env": {name: "./x"}})) == {"commands"}


@pytest.mark.parametrize("executor", ["single_threaded", "multi_threaded"])
def test_containers_of_threads_need_none(executor: str) -> None:
    container = {"executable": "component_container_isolated", "executor": executor}
    node = {"package": "demo", "plugin": "demo::Talker", "container": "c"}
    check_allowed(plan_of(node, containers={"c": container}), (), "here")


def test_python_of_a_ros_package_that_is_installed_needs_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of({"python": "demo.talker.Talker"})
    assert needs(plan) == {"python"}
    install_package(tmp_path, "demo")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'none'}:{tmp_path}")
    assert needs(plan) == set()


@pytest.mark.parametrize(
    ("argv", "permission"),
    [
        (("$(python)", "-c", "pass"), "commands"),
        (("$(harness)", "x"), "commands"),
        (("x",), "commands"),
        (("$(executable demo ../../x)",), "commands"),
        (("$(executable ../demo x)",), "commands"),
        (("$(executable demo ..)",), "commands"),
        (("$(executable demo talker)", "./x.py"), "commands"),
        (("$(executable demo talker)", "--ros-args", "-r", "a:=b", "--", "./x.py"), "commands"),
        (("$(executable demo talker)", "--ros-args", "--log-config-file", "x"), "commands"),
        (("$(executable demo talker)", "--ros-args", "-p"), "commands"),
        ((), "commands"),
        ((*LAUNCH_LINE, "package:=demo", "file:=x.py"), "commands"),
        ((*LAUNCH_LINE, "package:=a", "file:=b", "file:=./c", *LAUNCH_END), "commands"),
        ((*LAUNCH_LINE, "package:=a", "file:=b", *LAUNCH_END, "x:=y"), "commands"),
        ((*LAUNCH_LINE, "file:=./x.py", *LAUNCH_END), "python"),
        ((*LAUNCH_LINE, "package:=demo", "file:=../x", *LAUNCH_END), "python"),
        ((*LAUNCH_LINE, "package:=../demo", "file:=x", *LAUNCH_END), "python"),
        ((*HARNESS_ARGV, "./evil.py:main"), "commands"),
    ],
)
def test_a_plan_cannot_pass_a_command_off_as_a_program_of_r2bspec(
    argv: tuple[str, ...], permission: str
) -> None:
    plan = plan_of(OWN)
    check_allowed(plan, (), "here")
    changed = [msgspec.structs.replace(plan.processes[0], argv=argv), *plan.processes[1:]]
    assert needs(msgspec.structs.replace(plan, processes=tuple(changed))) == {permission}


@pytest.mark.parametrize(
    ("parts", "permission"),
    [
        ({"setup": {"x": {"command": ["./x"]}}}, "commands"),
        ({"after_ready": {"x": {"command": ["./x"]}}}, "commands"),
        ({"preprocessors": {"x": {"command": ["./x"]}}}, "commands"),
        ({"preprocessors": {"x": {"python": "./x.py:X"}}}, "python"),
        ({"preprocessors": {"x": {**OWN, "env": {"HOME": "."}}}}, "commands"),
        ({"containers": {"c": {"prefix": ["./x"]}}}, "commands"),
        ({"containers": {"c": {"env": {"LD_PRELOAD": "./x.so"}}}}, "commands"),
    ],
)
def test_no_part_of_a_spec_goes_around_the_permissions(
    parts: dict[str, Any], permission: str
) -> None:
    in_container = {"package": "demo", "plugin": "demo::Talker", "container": "c"}
    assert needs(plan_of(in_container if "containers" in parts else OWN, **parts)) == {permission}


def test_how_a_base_is_built_stays_on_the_machine_of_the_client() -> None:
    gate = {"base": {"build": [["touch", "built"]], "setup": "./sourced.bash"}}
    plan = plan_of(OWN, benchmark={**relay_spec()["benchmark"], "gate": gate})
    assert needs(plan) == set()
    assert not {b"built", b"sourced"} & set(canonical_json(plan).replace(b'"', b" ").split())


@pytest.mark.parametrize(
    "file", ["DEFAULT_FASTRTPS_PROFILES.xml", "x/USER_QOS_PROFILES.xml", "matplotlibrc"]
)
def test_files_that_are_loaded_unasked_need_a_permission(file: str) -> None:
    check_allowed(plan_of(OWN), ("commands",), "here", files=[file])
    check_allowed(plan_of(OWN), (), "here", files=["profiles.xml"])
    with pytest.raises(NotAllowedError, match="--allow-commands"):
        check_allowed(plan_of(OWN), (), "here", files=[file])


def test_libraries_are_loaded_from_installed_packages_only() -> None:
    plan = plan_of({"package": "demo", "plugin": "demo::Talker"})
    (container,) = (process for process in plan.processes if process.role == "container")
    others = tuple(process for process in plan.processes if process is not container)
    node = msgspec.structs.replace(container.nodes[0], package="../../../tmp/evil")
    changed = msgspec.structs.replace(container, nodes=(node,))
    assert needs(msgspec.structs.replace(plan, processes=(*others, changed))) == {"commands"}
    call = AfterReadyPlan(
        name="load",
        service="/container/_container/load_node",
        service_type="composition_interfaces/srv/LoadNode",
        timeout_ns=1,
    )
    assert needs(msgspec.structs.replace(plan, after_ready=(call,))) == {"commands"}
