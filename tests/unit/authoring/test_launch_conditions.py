"""Conditions, arguments, includes and groups of launch files in Python, XML and YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from r2bspec.api import load, validate
from r2bspec.cli.main import main

PYTHON = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.actions import RegisterEventHandler, TimerAction
from launch.conditions import IfCondition, LaunchConfigurationEquals, UnlessCondition
from launch.event_handlers import OnProcessStart
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import (
    AndSubstitution, EnvironmentVariable, EqualsSubstitution, LaunchConfiguration, NotSubstitution,
    PythonExpression, ThisLaunchFileDir)
from launch_ros.actions import ComposableNodeContainer, Node, PushRosNamespace
from launch_ros.descriptions import ComposableNode


def node(name, **more):
    return Node(package='cell', executable='eye', name=name, **more)


def generate_launch_description():
    side, simulated = LaunchConfiguration('side'), LaunchConfiguration('simulated')
    late = node('late')
    return LaunchDescription([
        DeclareLaunchArgument('side', default_value='left'),
        DeclareLaunchArgument('simulated', default_value='false'),
        node('real', condition=UnlessCondition(simulated)),
        node('never_simulated', condition=IfCondition(simulated)),
        node('by_name', condition=LaunchConfigurationEquals('side', 'left')),
        node('never_right', condition=LaunchConfigurationEquals('side', 'right')),
        node('compared', condition=IfCondition(EqualsSubstitution(side, 'left'))),
        node('evaluated', condition=IfCondition(
            PythonExpression(["'", side, "' in ('left', 'both')"]))),
        node('never_all', condition=IfCondition(
            AndSubstitution(simulated, NotSubstitution(simulated)))),
        GroupAction(condition=IfCondition('1'), actions=[
            PushRosNamespace(['cell_', side]),
            node('inside', arguments=['--on', EnvironmentVariable('CELL_PORT')],
                 parameters=[{'lamp': {'watts': 3.5}}])]),
        GroupAction(condition=IfCondition('0'), actions=[node('never_inside')]),
        ComposableNodeContainer(
            name='vision', namespace='', package='rclcpp_components',
            executable='component_container',
            composable_node_descriptions=[
                ComposableNode(package='image_proc', plugin='image_proc::RectifyNode',
                               name='rectify', condition=IfCondition('true'),
                               parameters=[{'queue_size': 7}],
                               remappings=[('image', ['/', side, '_image'])]),
                ComposableNode(package='image_proc', plugin='image_proc::DebayerNode',
                               name='never_debayer', condition=UnlessCondition('true'))]),
        TimerAction(period=3.0, actions=[node('delayed')]),
        RegisterEventHandler(OnProcessStart(target_action=late, on_start=[late])),
    ])
"""
XML = (Path(__file__).parent / "launch_files/conditions.launch.xml").read_text(encoding="utf-8")
MORE = (Path(__file__).parent / "launch_files/more.launch.xml").read_text(encoding="utf-8")
YAML = (Path(__file__).parent / "launch_files/conditions.launch.yaml").read_text(encoding="utf-8")
STARTED = ["real", "by_name", "compared", "evaluated", "inside", "rectify", "delayed"]


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CELL_PORT", "3")
    Path("more.launch.xml").write_text(MORE)


def made(name: str, content: str) -> tuple[Any, str]:
    """The spec of a launch file, which has no errors, and its text."""
    Path(name).write_text(content)
    assert main(["init", "made", "--from-launch", name]) == 0
    file = Path("made.r2b.yaml")
    assert [each.message for each in validate(file) if each.severity == "error"] == []
    return load(file), file.read_text()


@pytest.mark.parametrize(
    ("name", "content", "late"),
    [("a.launch.py", PYTHON, ["late"]), ("a.launch.xml", XML, []), ("a.launch.yaml", YAML, [])],
)
def test_only_what_is_started_is_a_node(name: str, content: str, late: list[str]) -> None:
    spec, _ = made(name, content)
    assert spec.namespace == "/"
    assert list(spec.graph.nodes) == STARTED + late
    inside, rectify = spec.graph.nodes["inside"], spec.graph.nodes["rectify"]
    assert (inside.namespace, inside.arguments) == ("/cell_left", ("--on", "3"))
    assert inside.parameters == {"lamp.watts": 3.5}
    assert (rectify.container, rectify.parameters) == ("vision", {"queue_size": 7})
    assert rectify.remappings == {"image": "/left_image"}


def test_delays_and_handlers_of_events_are_told() -> None:
    _, text = made("a.launch.py", PYTHON)
    assert "the delay of a TimerAction is left out" in text
    assert "what an event handler starts after another process is started with it" in text
