"""What cannot work is refused in words, and as early as it can be known."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import Any

import pytest

from r2bspec.report.findings_text import code_with_slug

pytest.importorskip("rclpy")

from ros_runs import (
    IMAGE,
    Bench,
    Finished,
    relay_node,
    relay_spec,
)
from ros_runs import (
    nothing_left as nothing_left,
)

# What these do cannot be told without running them: topics and parameters have made-up names.
NODES = """
import time

OUTPUT, INPUT = "".join(["out", "put"]), "".join(["in", "put"])


class Mute(Node):
    def __init__(self, **kwargs):
        super().__init__("mute", **kwargs)
        self.out = self.create_publisher(Image, OUTPUT, 10)
        self.create_subscription(Image, INPUT, lambda _: None, 10)


class Raises(Mute):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        raise ValueError("the calibration file is missing")


class Hangs(Mute):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        time.sleep(600)


class Dies(Mute):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        print("no licence", flush=True)
        raise SystemExit(7)


class Secretive(Mute):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name in ("spe" + "ed", "ra" + "te"):
            self.declare_parameter(name, 0)


def nothing(**kwargs):
    return None
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("refusals"))
    found.write_node("nodes.py", NODES)
    (found.folder / "broken.py").write_text(
        "import a_module_that_is_not_there\nclass Broken: ...\n"
    )
    return found


def graph_of(node: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return relay_spec(graph={"nodes": {"relay": node}}, **changes)


def impatient(node: dict[str, Any], start_timeout: str = "8 s") -> dict[str, Any]:
    """A spec whose time to start is over soon, for what never comes up."""
    spec = graph_of(node)
    spec["benchmark"]["start_timeout"] = start_timeout
    return spec


# Before anything starts


def refused(done: Finished) -> str:
    """The words of a refusal, after which nothing has been made and nothing started."""
    assert done.status == 2
    assert not done.folder.exists()
    return done.stderr


def test_a_topic_that_is_not_in_the_bag(bench: Bench) -> None:
    spec = relay_spec(data_loader={"bag": "./bag", "topics": {"/camrea": "loaded"}})
    said = refused(bench.run(spec))
    assert "r2b.yaml:6:" in said
    assert "/camrea" in said
    assert "/camera" in said


def test_a_bag_that_is_not_there(bench: Bench) -> None:
    spec = relay_spec(data_loader={"bag": "./gab", "topics": {"/camera": "loaded"}})
    said = refused(bench.run(spec))
    assert "r2b.yaml:4:" in said
    assert "./gab" in said


def test_a_monitor_that_no_node_writes_to(bench: Bench) -> None:
    spec = relay_spec(monitors={"out": {"topic": "ouptut", "format": IMAGE}})
    assert "ouptut" in refused(bench.run(spec))


def test_a_file_that_is_no_spec(bench: Bench) -> None:
    path = bench.folder / "rubbish.r2b.yaml"
    path.write_text("- [unclosed\n")
    assert "rubbish.r2b.yaml:" in refused(bench.run(path))


def test_a_spec_that_is_not_there(bench: Bench) -> None:
    refused(bench.run(bench.folder / "nothing.r2b.yaml"))


def test_an_output_folder_that_cannot_be_made(bench: Bench) -> None:
    (bench.folder / "a_file").write_text("")
    done = bench.run(relay_spec(), output=bench.folder / "a_file" / "run")
    assert "a_file/run cannot be created" in done.error
    refused(done)


# What is not installed


@pytest.mark.parametrize(
    ("node", "words"),
    [
        (
            {"package": "no_such_package", "executable": "node", "publishes": {"output": IMAGE}},
            "'no_such_package' is not installed",
        ),
        (
            {"command": ["no-such-program"], "publishes": {"output": IMAGE}},
            "program 'no-such-program' is not on PATH",
        ),
        (
            {"command": ["./spec.txt"], "publishes": {"output": IMAGE}},
            "./spec.txt: No such file",
        ),
        ({"python": "no_such_module.Node"}, "no_such_module"),
        ({"python": "./broken.py:Broken"}, "a_module_that_is_not_there"),
        ({"python": "./nothing.py:Node"}, "nothing.py"),
    ],
    ids=["package", "program", "path", "module", "import", "file"],
)
def test_what_is_not_installed_is_named(bench: Bench, node: dict[str, Any], words: str) -> None:
    done = bench.run(graph_of(node))
    assert done.status == 2
    assert words in done.stderr


def test_a_program_that_is_missing_is_missed_before_any_is_started(bench: Bench) -> None:
    spec = graph_of({"command": ["no-such-program"], "publishes": {"output": IMAGE}})
    spec["graph"]["nodes"]["other"] = relay_node(remappings={"output": "elsewhere"})
    done = bench.run(spec)
    assert "process relay: program 'no-such-program' is not on PATH" in done.error
    assert done.run().record.processes == ()


# While the graph comes up


def failed(done: Finished, status: int = 4) -> str:
    """The words of a failure, after which the run folder can be judged, as incomplete."""
    assert done.status == status
    record = done.run().record
    assert record.status == "incomplete"
    code, _, words = record.reason.partition("\n")[0].partition(": ")
    assert f"error[{code_with_slug(code)}]: {words}" in done.error
    return done.error


def test_a_parameter_that_no_node_declares(bench: Bench) -> None:
    node = {"python": "./nodes.py:Secretive", "parameters": {"rtae": 3}}
    done = bench.run(graph_of(node))
    # To try again would not help: the spec is to blame, as where validate finds the same.
    assert done.status == 2
    assert done.run().record.status == "incomplete"
    where = re.search(
        r"r2b\.yaml:(\d+):\d+: error\[R2B211 [a-z-]+\]: .*/r2b/relay .*'rtae'", done.stderr
    )
    assert where
    assert f"{where[1]} |         rtae: 3" in done.stderr
    assert "did you mean 'rate'?" in done.stderr
    assert [each.code for each in done.run().record.differences] == ["R2B211"]


def test_a_plan_from_a_file_has_no_places_but_the_same_code(bench: Bench) -> None:
    node = {"python": "./nodes.py:Secretive", "parameters": {"rtae": 3}}
    spec = bench.write(graph_of(node), "planned")
    plan = bench.folder / "planned.json"
    made = subprocess.run(
        [sys.executable, "-m", "r2bspec", "plan", str(spec)],
        check=False,
        capture_output=True,
        cwd=bench.folder,
    )
    plan.write_bytes(made.stdout)
    done = bench.run(plan)
    assert done.status == 2
    assert done.error.startswith(
        f"error[{code_with_slug('R2B211')}]: /r2b/relay declares no parameter 'rtae'"
    )


def test_a_constructor_that_raises(bench: Bench) -> None:
    done = bench.run(graph_of({"python": "./nodes.py:Raises"}))
    said = failed(done, 2)
    assert "/r2b/relay cannot be created: ValueError: the calibration file is missing" in said
    # The log has what a developer of the node needs.
    assert 'raise ValueError("the calibration file is missing")' in done.log("relay")


def test_a_constructor_that_never_returns(bench: Bench) -> None:
    said = failed(bench.run(impatient({"python": "./nodes.py:Hangs"}, "1 s")))
    assert "process relay did not respond within 1 s" in said


def test_a_process_that_ends_while_it_starts(bench: Bench) -> None:
    said = failed(bench.run(graph_of({"python": "./nodes.py:Dies"})))
    assert "process relay exited with status 7" in said
    assert "no licence" in said


def test_a_function_that_returns_no_node(bench: Bench) -> None:
    done = bench.run(graph_of({"python": "./nodes.py:nothing"}))
    assert done.status in {2, 4}
    assert "./nodes.py:nothing returned NoneType, not an rclpy node" in done.error
