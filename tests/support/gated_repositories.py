"""A repository with a gated benchmark, and what a gate says of its changes; nothing is played."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from data_bags import text, write_bag
from git_repositories import commit, git
from r2bspec import api
from r2bspec.compare.gate_rules import require_objectives
from r2bspec.compare.merge_gate import GateSides, MergeGate
from r2bspec.language.selected_spec import SpecSelection

SPEC = "bench/words.r2b.yaml"
BASE = "refs/heads/main"

_SPEC = """\
r2bspec: 1
name: words
extends: common/limits.yaml
variables: {threads: 1, strict: 1}
data_loader: {bag: ./drive, topics: {/words: recorded}}
preprocessors:
  cut:
    python: ../src/cut.py:Cut
    parameters: ../src/cut.yaml
    remappings: {words: recorded, cut: loaded}
playback: {inputs: {words: {from: loaded, format: std_msgs/msg/String, timestamp: none}}}
graph:
  nodes:
    echo:
      python: ../src/echo.py:Echo
      parameters: {threads: $(var threads)}
      memory_limit: 200 MiB
monitors: {out: {topic: out, format: std_msgs/msg/String, match: order}}
benchmark: {rates: [30 Hz], iterations: 10, duration: 1 s}
slos:
  fast: {at: 30 Hz, require: [latency.p50 < 1 ms], when: {strict: 1}}
  same: {at: 30 Hz, require: [latency.p50 <= 105 % of baseline]}
"""
_LIMITS = """\
slos:
  kept: {at: 30 Hz, require: [drop_rate <= 10 %]}
"""
_NODE = """\
from rclpy.node import Node
from std_msgs.msg import String


class {name}(Node):
    def __init__(self):
        super().__init__("{node}")
        self.declare_parameter("threads", 1)
        self.declare_parameter("length", 1)
        self.publisher = self.create_publisher(String, "{output}", 10)
        self.create_subscription(String, "{input}", self.on_words, 10)

    def on_words(self, words):
        self.publisher.publish(words)
"""
FILES = {
    SPEC: _SPEC,
    "bench/common/limits.yaml": _LIMITS,
    "src/cut.py": _NODE.format(name="Cut", node="cut", input="words", output="cut"),
    "src/cut.yaml": "/**:\n  ros__parameters: {length: 100}\n",
    "src/echo.py": _NODE.format(name="Echo", node="echo", input="words", output="out"),
    ".gitignore": "runs/\n",
}


def write_words(folder: Path, words: str = "many words", storage: str = "sqlite3") -> None:
    """Write the recording, or another one in its place."""
    shutil.rmtree(folder, ignore_errors=True)
    messages = [("/words", 10_000_000 * number, text(f"{words} {number}")) for number in range(90)]
    write_bag(folder, messages, storage="mcap" if storage == "mcap" else "sqlite3")


def gated_repository(top: Path) -> Path:
    """Make a repository whose branch ``main`` is the base; HEAD is on ``change``, at the same."""
    top.mkdir(parents=True)
    write_words(top / "bench/drive")
    commit(top, FILES)
    git(top, "checkout", "--quiet", "-b", "change")
    return top


def edit(path: Path, *changes: tuple[str, str]) -> None:
    """Replace texts of a file, each of which it must have."""
    content = path.read_text()
    for before, after in changes:
        assert before in content, before
        content = content.replace(before, after)
    path.write_text(content)


def gate(*paths: str, base: str = BASE, allow: Sequence[str] = ()) -> list[GateSides]:
    """Compare all specs under some paths of the working folder with the base, as the verb does."""
    with api.open_gate(base, allow) as opened:
        return sides_of(opened, *paths)


def sides_of(opened: MergeGate, *paths: str) -> list[GateSides]:
    """The same of a gate that is open."""
    sides = []
    for spec in opened.select(paths or ("bench",)).specs:
        selection = SpecSelection(spec.head)
        for loaded in selection.load_cases():
            case = replace(selection, case=loaded.case)
            prepared = api.prepare(case)
            require_objectives(prepared.plan.objectives, str(spec.head))
            sides.append(opened.sides(opened.compare(spec, case, prepared)))
    return sides
