"""Promise: no input makes a call take much processor time, memory or output.

The promise is 2 s of CPU and 500 MB. `MOST_CPU_S` is more, because other programs share the caches
and threads of a processor; what is refused or linear stays far below, what is quadratic exceeds it.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from clean_answers import wrong_with
from hostile_calls import LONGEST_S, call, change_database, small_run
from hostile_inputs import SPEC

from data_bags import START_NS, text, write_bag, write_mcap
from editor_messages import EXIT, INITIALIZE, SHUTDOWN, changed, notice, opened, request
from nightly import size

MOST_CPU_S = 6.0

pytestmark = pytest.mark.timeout(4 * LONGEST_S)

MESSAGES = [("/a", number, text("x")) for number in range(5)]
FIGURES = {"BasicPerformanceMetrics.MEAN_FRAME_RATE": 30.0}


def mcap(folder: Path, number: int = 2_000_000) -> str:
    """A file without a summary, whose records are empty but for its messages."""
    file = write_mcap(folder / "x.mcap", MESSAGES)
    data = file.read_bytes()
    footer = struct.pack("<BQQQI", 2, 20, 0, 0, 0)
    end = data.index(struct.pack("<BQ", 15, 4))  # DataEnd
    empty = struct.pack("<BQ", 0x80, 0) * number
    file.write_bytes(data[:end] + empty + footer + data[:8])
    return file.name


def ros1(definition: Callable[[], str]) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        from rosbags.rosbag1 import Writer

        with Writer(folder / "x.bag") as writer:
            kind = "x/msg/Large"
            of = writer.add_connection("/a", kind, msgdef=definition(), md5sum="0" * 32)
            writer.write(of, START_NS, bytes(16))
        return "x.bag"

    return write


def profiles(value: str) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        bag = write_bag(folder / "x", MESSAGES)
        change_database(bag / "x.db3", f"UPDATE topics SET offered_qos_profiles = '{value}'")  # noqa: S608
        return bag.name

    return write


def run(segments: int) -> Callable[[Path], str]:
    """A record that lists many segments, as a short file can."""

    def write(folder: Path) -> str:
        file = small_run(folder / "x") / "record.json"
        record = json.loads(file.read_text())
        first = record["segments"][0]
        record["segments"] = [{**first, "id": f"s{number}"} for number in range(segments)]
        file.write_text(json.dumps(record))
        return "x"

    return write


def document(content: Callable[[], object], name: str = "x.json") -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        made = content()
        (folder / name).write_text(made if isinstance(made, str) else json.dumps(made))
        return name

    return write


BAG: list[tuple[str, ...]] = [("data", "info"), ("data", "verify"), ("import",)]
REPORT: list[tuple[str, ...]] = [("import",), ("compare", "@"), ("report",), ("plan",)]
RUN: list[tuple[str, ...]] = [("judge",), ("compare", "@"), ("report", "--report", "markdown=-")]
TEXT: list[tuple[str, ...]] = [("validate",), ("plan",)]

BAGS: dict[str, Callable[[Path], str]] = {
    "empty records of MCAP": mcap,
    "fields of ROS 1": ros1(lambda: "".join(f"int8 f{n}\n" for n in range(100_000))),
    "comments of ROS 1": ros1(lambda: "# x\n" * 2_000_000 + "int8 a\n"),
    "brackets of QoS": profiles("[" * 50_000),
    "profiles of QoS": profiles("- {depth: 1}\n" * 50_000),
}
REPORTS: dict[str, Callable[[], object]] = {
    "rates of a report": lambda: {f"{n}.5fps": FIGURES for n in range(100_000)} | FIGURES,
    "monitors of a report": lambda: {f"m{n}": FIGURES for n in range(50_000)} | FIGURES,
    "shared figures of a report": lambda: (
        {f"CPUProfilingMetrics.{n}": 1 for n in range(9_000)}
        | {f"m{n}": FIGURES for n in range(9_000)}
    ),
    "a rate of many digits": lambda: {f"{'9' * 5_000_000}fps": FIGURES} | FIGURES,
    "a name of a report": lambda: (
        FIGURES | {"metadata": {"BenchmarkMetadata.NAME": "x" * 5_000_000}}
    ),
    "numbers": lambda: f"[{'1,' * 5_000_000}1]",
    "empty maps": lambda: f"[{'{},' * 3_300_000}1]",
    "keys": lambda: {f"k{n}": 1 for n in range(800_000)},
}
SPECS: dict[str, Callable[[], str]] = {
    "comments": lambda: "# x\n" * 2_400_000,
    "empty lines": lambda: "\n" * 9_900_000,
    "words": lambda: f"title: '{'x ' * 4_900_000}'\n",
    "lines of a text": lambda: "title: |\n" + "  x\n" * 2_400_000,
    "escapes": lambda: 'title: "' + "\\x41" * 2_400_000 + '"\n',
    "labels": lambda: f"labels: {{{', '.join(f'k{n}: 1' for n in range(190_000))}}}\n",
    "references": lambda: "variables: {a: 1}\ntitle: '" + "$(var a)" * 1_200_000 + "'\n",
    "open references": lambda: f"title: '{'$(' * 4_900_000}'\n",
    "values of a search": lambda: (
        f"labels: {{{', '.join(f'k{n}: 1' for n in range(5_000))}}}\n"
        f"tune: {{values: {{graph.nodes.n.nice: [{', '.join(map(str, range(64)))}]}}}}\n"
    ),
    "unknown keys": lambda: "".join(f"k{n}: 1\n" for n in range(190_000)),
}


def spec(more: Callable[[], str]) -> Callable[[Path], str]:
    return document(lambda: SPEC + more(), "x.r2b.yaml")


COSTS = {
    **{name: (write, BAG) for name, write in BAGS.items()},
    "segments without samples": (run(1_500), RUN),
    **{name: (document(content), REPORT) for name, content in REPORTS.items()},
    **{name: (spec(more), TEXT) for name, more in SPECS.items()},
}


@pytest.mark.parametrize("name", list(COSTS)[:: size(3, 1)])
def test_an_input_has_a_bounded_cost_and_output(name: str, tmp_path: Path) -> None:
    write, calls = COSTS[name]
    file = write(tmp_path)
    for words in calls[: size(2, 9)]:
        arguments = [words[0], *([words[1], file] if words[:1] == ("data",) else [file])]
        arguments += [file if word == "@" else word for word in words[1:] if words[0] != "data"]
        answer = call(*arguments, cwd=tmp_path, environ={"XDG_CACHE_HOME": str(tmp_path)})
        assert not wrong_with(answer, MOST_CPU_S), (arguments, wrong_with(answer, MOST_CPU_S))


def edits(text: str, number: int) -> bytes:
    start = {"line": 0, "character": 0}
    change = {"range": {"start": start, "end": start}, "text": "x"}
    return opened(text) + changed(*[change] * number)


CONVERSATIONS: dict[str, Callable[[], bytes]] = {
    "lines of a header": lambda: b"X: y\r\n" * 2_000_000,
    "lengths that cannot be": lambda: b"Content-Length: -5\r\n\r\n" * 300_000,
    "empty lines": lambda: b"\r\n" * 5_000_000,
    "a line of a header": lambda: b"X: " + b"y" * 50_000_000 + b"\r\n",
    "cancelled requests": lambda: b"".join(notice("$/cancelRequest", id=n) for n in range(30_000)),
    "unknown requests": lambda: b"".join(request(n + 5, "x") for n in range(20_000)),
    "lists": lambda: request(5, "x", a=[[]] * 5_000_000),
    "positions": lambda: request(
        5, "textDocument/selectionRange", positions=[{"line": 0, "character": 0}] * 500_000
    ),
    "emoji": lambda: edits("😀" * 2_400_000, 1),
    "halves of a character": lambda: edits("\ud83d" * 2_400_000, 1),
    "changes": lambda: edits("x", 100_000),
    "changes of a long line": lambda: edits("x" * 9_000_000, 5_000),
    "changes of many lines": lambda: edits("x\n" * 4_000_000, 5_000),
    "errors": lambda: b"Content-Length: 1\r\n\r\n{" * 10_000,
    "a long document": lambda: opened(SPEC + "labels:\n" + "  k: 1\n" * 1_400_000),
    "a long line": lambda: opened(SPEC + f"title: [{'1,' * 4_900_000}]\n"),
    "long documents": lambda: b"".join(
        opened(SPEC + "".join(f"k{n}: 1\n" for n in range(300_000)), f"file:///{number}.r2b.yaml")
        for number in range(10)
    ),
    "a long body": lambda: b"Content-Length: 200000000\r\n\r\n" + bytes(200_000_000),
    "a body of lines": lambda: b"Content-Length: 200000000\r\n\r\n" + b"x\n" * 100_000_000,
}


@pytest.mark.parametrize("name", list(CONVERSATIONS)[:: size(3, 1)])
def test_a_conversation_of_an_editor_has_a_bounded_cost(name: str, tmp_path: Path) -> None:
    sent = b"".join((INITIALIZE, CONVERSATIONS[name](), b"\r\n", SHUTDOWN, EXIT))
    said = call("lsp", cwd=tmp_path, stdin=sent)
    assert not wrong_with(replace(said, said=b""), MOST_CPU_S)
    assert said.said.rstrip().endswith(b'"id":"shutdown","result":null}')
