"""Why a node could not be created: the sentences of rclcpp, each at its place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ament_packages import install_package
from plans import node_plan, process_plan
from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.bringup.node_faults import nodes_with_one_name, not_created, not_loaded
from r2bspec.execute.bringup.readiness import StartDeadline
from r2bspec.execute.errors import GraphDifferencesError, ProcessDiedError
from r2bspec.language.spec import Container
from r2bspec.plan.command_lines import container_argv
from r2bspec.record.run_folder import RunFolder

NODE = node_plan("rectify", namespace="/r2b", package="camera", plugin="camera::Rectify")
THREW = "Component constructor threw an exception: "


@pytest.fixture(autouse=True)
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with one component and one without any."""
    components = "camera::RectifyNode;lib/libcamera.so\n"
    install_package(tmp_path, "camera", rclcpp_components=components)
    install_package(tmp_path, "tools")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))


def refused(reason: str, package: str = "camera") -> GraphDifferencesError:
    node = node_plan("rectify", namespace="/r2b", package=package, plugin="camera::Rectify")
    error = not_loaded(node, "cpp", reason, "; it printed nothing")
    assert error.exit_code == 2
    return error


UNSET = ("parameter 'model' is required, and is not set", "parameter", "model")
OUT = ("parameter 'rate' is out of its range", "parameter", "rate")
REFUSED = ("parameter 'rate' was refused: it has to be even", "parameter", "rate")
DOUBLE = ("parameter 'gain' is of type double, and cannot be of type integer", "parameter", "gain")
WRONG_TYPE = (
    f"{THREW}parameter 'gain' has invalid type: Wrong parameter type, parameter {{gain}} is of "
    "type {double}, setting it to {integer} is not allowed."
)
NO_LIBRARY = (
    "Failed to load library: Could not load library dlopen error: libcuda.so.1: cannot open shared "
    "object file: No such file or directory, at ./src/shared_library.c:99"
)
NO_CLASS = "Failed to find class with the requested plugin name."
# What component_manager.cpp and node_parameters.cpp of rclcpp 28 answer.
ANSWERS = {
    WRONG_TYPE: DOUBLE,
    f"{THREW}Statically typed parameter 'model' must be initialized.": UNSET,
    f"{THREW}parameter 'model' is not initialized": UNSET,
    f"{THREW}parameter 'rate' could not be set: Parameter {{rate}} doesn't comply with": OUT,
    f"{THREW}parameter 'rate' could not be set: it has to be even": REFUSED,
    f"{THREW}no camera": ("its constructor threw an exception: no camera", "node", ""),
    THREW.removesuffix(": "): ("its constructor threw an exception", "node", ""),
    NO_LIBRARY: ("library libcuda.so.1 is missing", "plugin", ""),
    NO_CLASS: ("package camera has no component 'camera::Rectify'", "plugin", ""),
    "": ("the container gave no reason", "node", ""),
}


@pytest.mark.parametrize("reason", ANSWERS)
def test_each_mistake_has_its_words_and_its_place(reason: str) -> None:
    (difference,) = refused(reason).differences
    begin = "/r2b/rectify (camera::Rectify) was not loaded into container cpp: "
    assert difference.message.startswith(begin)
    found = (difference.message.removeprefix(begin), difference.part, difference.name)
    assert (difference.code, found) == ("R2B665", ANSWERS[reason])


def test_an_integer_for_a_double_and_a_misspelt_class_are_corrected() -> None:
    assert "write 1.0" in refused(WRONG_TYPE).hint
    assert refused(NO_CLASS).hint == "did you mean 'camera::RectifyNode'?"


@pytest.mark.parametrize(
    ("package", "said"),
    [("nowhere", "package nowhere is not installed"), ("tools", "package tools has no components")],
)
def test_a_package_that_is_missing_is_told_from_one_without_components(
    package: str, said: str
) -> None:
    (difference,) = refused("Could not find requested resource in ament index", package).differences
    assert said in difference.message
    assert difference.part == "package"


def died(output: str) -> ProcessDiedError:
    text = f"process rectify was killed by SIGABRT; its last output:\n{output}"
    return ProcessDiedError(text, process="rectify", output=output)


def test_an_executable_with_the_same_mistake_has_the_same_words_place_and_status() -> None:
    error = not_created(
        died(
            "terminate called after throwing an instance of "
            "'rclcpp::exceptions::UninitializedStaticallyTypedParameterException'\n"
            "  what():  Statically typed parameter 'model' must be initialized.\n"
        ),
        [NODE],
    )
    assert error is not None
    (difference,) = error.differences
    assert difference.message.endswith(": parameter 'model' is required, and is not set")
    assert (difference.part, difference.name, error.exit_code) == ("parameter", "model", 2)


def test_an_exception_of_python_is_named_with_its_line() -> None:
    error = not_created(
        died(
            "Traceback (most recent call last):\n"
            '  File "/opt/x/main.py", line 3, in <module>\n    main()\n'
            '  File "/opt/x/node.py", line 12, in __init__\n    raise ValueError("no camera")\n'
            "ValueError: no camera\n"
        ),
        [NODE],
    )
    assert error is not None
    assert str(error).endswith("it raised ValueError: no camera (node.py, line 12)")
    assert "Traceback" not in error.details


def test_a_container_that_ends_is_named_with_what_it_loaded(tmp_path: Path) -> None:
    class Dying:
        """In place of the supervisor: the container is dead when the component is asked for."""

        def request(self, *_: object) -> None:
            raise died("Segmentation fault")

    supervisor: Any = Dying()
    launcher = Launcher(supervisor, supervisor, RunFolder(tmp_path / "run"), tmp_path)
    argv = container_argv("cpp", Container(), "/r2b")
    plan = process_plan("cpp", "container", argv=argv)
    with pytest.raises(ProcessDiedError) as raised:
        launcher._load_component(supervisor, plan, NODE, StartDeadline(10**9))
    assert str(raised.value).startswith(
        "while /r2b/rectify (camera::Rectify) was loaded: process rectify was killed by SIGABRT"
    )
    assert raised.value.exit_code == 4


@pytest.mark.parametrize(
    ("argv", "said", "codes"),
    [
        (
            ("x", "-r", "__node:=stack"),
            "[WARN] Publisher already registered for node name: 'stack'",
            ["R2B245"],
        ),
        (("x", "-r", "__node:=stack"), "[INFO] started", []),
        (("x",), "[WARN] Publisher already registered for node name: 'stack'", []),
    ],
)
def test_nodes_of_an_executable_that_got_one_name_are_told(
    tmp_path: Path, argv: tuple[str, ...], said: str, codes: list[str]
) -> None:
    log = tmp_path / "stack.log"
    log.write_text(f"{said}\n")
    found = nodes_with_one_name(process_plan("stack", "command", "stack", argv=argv), log)
    assert [each.code for each in found] == codes
