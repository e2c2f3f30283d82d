"""Hostile scripts and launch files: a finding or a spec, never a traceback or a hang.

What is hostile is answered in a process of its own, with limits of memory and processor time.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from clean_answers import wrong_with
from hostile_calls import call
from readers import MARKUP

SCRIPT = """
from launch.actions import GroupAction
from launch.conditions import IfCondition
from launch.substitutions import AndSubstitution, LaunchConfiguration, TextSubstitution
from launch_ros.actions import Node
from ros2_benchmark import ROS2BenchmarkConfig, ROS2BenchmarkTest
from std_srvs.srv import SetBool

x, action = {}, Node(package='a', executable='b')
CODE

def launch_setup(prefix, timeout):
    return [Node(package='cell', executable='cell', name='own', parameters=[x]), action]

def generate_test_description():
    return HostileTest.generate_test_description_with_nsys(launch_setup)

class HostileTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(benchmark_name='Hostile', benchmark_mode='LIVE')

    def pre_benchmark_hook(self):
        self.create_service_client_blocking(SetBool, 'x').call_async(x)
"""
LAUNCH = """
from launch import LaunchDescription
from launch_ros.actions import Node
x = {}
CODE
def generate_launch_description():
    return LaunchDescription([Node(package='p', executable='e', parameters=[x])])
"""
LARGE = {
    "map doubled": "for i in range(60):\n    x = {'a': x, 'b': x}",
    "items doubled": "for i in range(60):\n    y = {}\n    y['a'] = x\n    y['b'] = x\n    x = y",
    "list doubled": "t = 1\nfor i in range(60):\n    t = [t for _ in (0, 1)]\nx = {'a': t}",
    "tuple as a key": "t = ()\nfor i in range(60):\n    t = (t, t)\nx = {}[t]",
    "keys made again": (
        "t = (1,)\nfor i in range(12):\n    t = (t, t)\nx = {t: 1 for _ in range(9000)}"
    ),
    "arguments doubled": "def f(*a):\n    return a\nfor i in range(60):\n    x = f(x, x)",
    "names doubled": "def f(**a):\n    return a\nfor i in range(60):\n    x = f(a=x, b=x)",
    "part of itself": "x['a'] = x",
    "made long": "x = [1]\nfor i in range(9000):\n    y = [x] * 9999\nx = {'a': y}",
    "shown again": "y = [1] * 9000\nfor i in range(9000):\n    for j in range(20):\n        str(y)",
    "digits": "x = {'a': 0x" + "f" * 50_000 + "}",
    "negative digits": "x = {'a': -0x" + "f" * 50_000 + "}",
    "digits of a text": "x = {'a': int('0x" + "f" * 50_000 + "', 16)}",
    "texts": "y = 'a' * 9999\nx = {'a': [y + str(i) for i in range(9000)]}",
}
"""Code whose values would be large, or take long: more than the limits."""
LARGE_ACTIONS = {
    "groups doubled": "for i in range(60):\n    action = GroupAction(actions=[action, action])",
    "group in itself": "a = []\naction = GroupAction(actions=a)\na.append(action)",
    "many nodes": "action = [action for i in range(9000)]",
}
UNUSUAL = {
    "condition doubled": (
        "c = LaunchConfiguration('a')\nfor i in range(60):\n    c = AndSubstitution(c, c)\n"
        "action = Node(package='a', executable='b', condition=IfCondition(c))"
    ),
    "request doubled": (
        "x = SetBool.Request()\nfor i in range(60):\n    y = SetBool.Request()\n"
        "    y.a = x\n    y.b = x\n    x = y"
    ),
    "request in itself": "x = SetBool.Request()\nx.a = x",
    "class of bases": (
        "class A:\n    pass\nfor i in range(60):\n    class A(A, A):\n        pass\nA().b"
    ),
}
"""Code that would take long, and of which a part is left out."""


MOST_CPU_S = 10
"""Ten times what is needed: what doubles sixty times, or is quadratic, takes more."""


def answer(arguments: tuple[str, ...], folder: Path) -> str:
    """What r2bspec says, in a process of its own with limited memory and processor time."""
    answered = call(*arguments, cwd=folder)
    assert wrong_with(answered, MOST_CPU_S) == ""
    return answered.said.decode()


@pytest.mark.parametrize(
    ("code", "words"),
    [
        *((code, ("import", "script.py")) for code in LARGE.values()),
        *((code, ("import", "--check", "script.py")) for code in LARGE_ACTIONS.values()),
    ],
    ids=[*LARGE, *LARGE_ACTIONS],
)
def test_large_values_of_scripts_are_refused(
    code: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "script.py").write_text(SCRIPT.replace("CODE", code))
    assert "script.py:1:1: error[R2B703" in answer(words, tmp_path)


@pytest.mark.parametrize("kind", ["map doubled", "part of itself", "digits", "texts"])
def test_large_values_of_launch_files_are_refused(kind: str, tmp_path: Path) -> None:
    (tmp_path / "a.launch.py").write_text(LAUNCH.replace("CODE", LARGE[kind]))
    said = answer(("init", "made", "--from-launch", "a.launch.py"), tmp_path)
    assert "error[R2B703 script-too-complex]: a.launch.py:1:1: " in said
    assert not (tmp_path / "made.r2b.yaml").exists()


@pytest.mark.parametrize("code", UNUSUAL.values(), ids=UNUSUAL)
def test_what_would_take_long_is_left_out(code: str, tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT.replace("CODE", code))
    assert "R2B710 not-imported" in answer(("import", "script.py"), tmp_path)


def included(name: str, number: int) -> str:
    return f'<include file="$(dirname)/{name}.launch.xml"/>' * number


BOMB = "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 10))
MARKUPS = {
    "references that stay open": ('<node pkg="p" exec="e" args="' + "$(" * 60_000 + '"/>', "703"),
    "open name": ('<node pkg="p" exec="' + "$(" * 60_000 + '"/>', "703"),
    "nested": ('<node pkg="p" exec="' + "$(" * 40_000 + ")" * 40_000 + '"/>', "703"),
    "many": ('<node pkg="p" exec="' + "$(env A)" * 30_000 + '"/>', "703"),
    "doubled": (
        '<let name="a" value="xx"/>' + '<let name="a" value="$(var a)$(var a)"/>' * 60,
        "703",
    ),
    "long again and again": (
        '<let name="a" value="' + "x" * 90_000 + '"/>' + '<node pkg="$(var a)"/>' * 4_000,
        "703",
    ),
    "includes": (included("first", 90), "703"),
    "nodes": ('<node pkg="p" exec="e"/>' * 9_000, "703"),
    "groups": ("<group>" * 1_000 + "</group>" * 1_000, "702"),
}
DOCTYPES = (
    '<?x <!-- ?><!DOCTYPE a [<!ENTITY b "c">]><launch>&b;<!-- --></launch>',
    f'<?x <!-- ?><!DOCTYPE a [<!ENTITY a0 "lol">{BOMB}]><launch>&a9;<!-- --></launch>',
    '<?x <!-- ?><!DOCTYPE a SYSTEM "file:///etc/passwd"><launch/><!-- -->',
    "<!-- --><!DOCTYPE a><launch/>",
)


@pytest.mark.parametrize(("inside", "code"), MARKUPS.values(), ids=MARKUPS)
def test_large_launch_files_in_xml_are_refused(inside: str, code: str, tmp_path: Path) -> None:
    (tmp_path / "a.launch.xml").write_text(f"<launch>{inside}</launch>")
    for name, after in (("first", "second"), ("second", "third"), ("third", "none")):
        text = f"<launch>{included(after, 90)}</launch>"
        (tmp_path / f"{name}.launch.xml").write_text(text)
    said = answer(("init", "made", "--from-launch", "a.launch.xml"), tmp_path)
    assert f"error[R2B{code} " in said
    assert "a.launch.xml:1:1" in said
    assert len(said) < 1_000


@pytest.mark.parametrize("text", ["\ufeff<launch><x", "", " \n"])
def test_xml_is_not_taken_for_yaml(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.launch.xml").write_text(text, encoding="utf-8")
    assert "invalid XML" in answer(("init", "made", "--from-launch", "a.launch.xml"), tmp_path)


@pytest.mark.parametrize("text", DOCTYPES)
def test_the_parser_refuses_document_types(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.launch.xml").write_text(text)
    said = answer(("init", "made", "--from-launch", "a.launch.xml"), tmp_path)
    assert "error[R2B702 script-syntax]: a.launch.xml:1:" in said
    assert "declarations (<!DOCTYPE>, <!ENTITY>) are refused" in said


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.launch.xml", MARKUP.replace('default="b"', 'default="$(env A"')),
        ("a.launch.xml", '<launch><node pkg="p" exec="e" args="' + "$(env (" * 9 + '"/></launch>'),
        (
            "a.launch.xml",
            '<launch><node pkg="p" exec="e"><param name="a" value="0x' + "f" * 50_000 + '"/></node>'
            "</launch>",
        ),
        ("a.launch.xml", "<launch>" + "<a/>" * 50_000 + "</launch>"),
    ],
    ids=["open", "brackets", "digits", "unknown entities"],
)
def test_what_is_long_in_a_launch_file_is_no_crash(name: str, content: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    assert "created made.r2b.yaml" in answer(("init", "made", "--from-launch", name), tmp_path)
