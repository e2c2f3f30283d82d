"""docs/contributing.md tells the truth: each recipe is carried out in a copy of the package.

A recipe whose change takes a file that the page does not list makes the change incomplete here, and
one that lists too many files fails as well.
"""

from __future__ import annotations

import json
import re
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest

from edited_package import ROOT, EditedPackage

PAGE = (ROOT / "docs" / "contributing.md").read_text(encoding="utf-8")
OVERVIEW = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")

MOST_FILES = {
    "A percentile in all reports": 1,
    "A validation rule": 1,
    "When a late message counts as lost": 1,
    "Another RMW": 1,
    "The method of a verdict": 3,
    "A report format": 2,
    "A kind of node": 3,
    "The length of a probe": 1,
    "An exit code": 1,
    "A bag storage": 2,
}
"""How many files each change may take."""

RECIPES = {
    title: re.findall(r"^- `([^`]+)`:", text, re.MULTILINE)
    for title, text in re.findall(r"^## (.+)\n((?:(?!^## ).*\n)+)", PAGE, re.MULTILINE)
}

SPEC = """\
r2bspec: 1
name: example
data_loader:
  bag: r2b_storage
  topics: {/d455_1_rgb_image: image}
playback:
  inputs:
    image: {from: image, format: sensor_msgs/msg/Image}
graph:
  nodes:
    relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image, output: out}}
monitors:
  out: {topic: out, format: sensor_msgs/msg/Image}
benchmark:
  rates: [30 Hz]
  search: {min: 10 Hz, max: 100 Hz}
"""


class TestPages:
    @pytest.mark.parametrize("title", MOST_FILES)
    def test_a_recipe_lists_no_more_files_than_it_may(self, title: str) -> None:
        assert 1 <= len(RECIPES[title]) <= MOST_FILES[title]

    def test_the_table_has_every_recipe_and_its_number_of_files(self) -> None:
        rows = re.findall(r"^\| \[(.+)\]\(#(.+)\) \| (\d+) \|$", PAGE, re.MULTILINE)
        assert [title for title, _, _ in rows] == list(MOST_FILES)
        for title, anchor, number in rows:
            assert anchor == title.lower().replace(" ", "-")
            assert int(number) == len(RECIPES[title])

    @pytest.mark.parametrize("text", [PAGE, OVERVIEW], ids=["docs/contributing", "CONTRIBUTING"])
    def test_every_file_that_is_named_is_there(self, text: str) -> None:
        folders = r"(?:r2bspec|tests|docs|schemas)/[\w./<>-]+"
        named = {each.rstrip("./") for each in re.findall(rf"`({folders})`", text)}
        assert len(named) > 5
        missing = {name for name in named if not (ROOT / re.sub(r"/<.*", "", name)).exists()}
        assert missing == set()

    def test_the_overview_has_every_package_in_the_order_of_the_layers(self) -> None:
        settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
        contract = settings["tool"]["importlinter"]["contracts"][0]
        layers = [re.findall(r"\w+", layer) for layer in contract["layers"]]
        rows = re.findall(r"^\| (`[^|]+`) \| ", OVERVIEW.partition("## Tests")[0], re.MULTILINE)
        listed = [re.findall(r"`(\w+)`", row) for row in rows]
        assert listed == [*layers, ["nodes"]]


@pytest.fixture
def package(tmp_path: Path) -> EditedPackage:
    return EditedPackage(tmp_path)


def check_files(title: str, package: EditedPackage) -> None:
    """See that the files of a recipe are those that were changed, one for one."""
    patterns = [re.sub(r"<\w+>", "*", name) for name in RECIPES[title] if name[:5] != "docs/"]
    changed = sorted(package.changed)
    assert len(changed) == len(patterns)
    for pattern in patterns:
        assert [name for name in changed if fnmatch(name, pattern)], (pattern, changed)


RENDER_ALL = """
from pathlib import Path
from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.report.format_registry import renderer
from report_runs import USUAL
run = USUAL.write(Path("run"))
reported = ReportInput(result=result_of(run), run=run)
for name in {names}:
    Path(name).write_bytes(renderer(name)(reported))
"""


def test_a_percentile_in_all_reports(package: EditedPackage) -> None:
    names = ("text", "markdown", "html", "csv", "openmetrics", "bencher", "benchmark_smaller")
    package.edit(
        "r2bspec/measure/distribution_parts.py",
        ("    p90: float | None\n", "    p90: float | None\n    p75: float | None = None\n"),
        ('MAIN_PERCENTILES: Final = ("p50", ', 'MAIN_PERCENTILES: Final = ("p50", "p75", '),
    )
    package.python(RENDER_ALL.format(names=names))
    shown = {name: (package.folder / name).read_text() for name in names}
    assert {name for name, text in shown.items() if "p75" in text} == set(names) - {"openmetrics"}
    assert 'quantile="0.75"' in shown["openmetrics"]
    # In ascending order, wherever it was written.
    assert re.search(r"p50\s+p75\s+p90", shown["text"])
    check_files("A percentile in all reports", package)


RULE = '''
"""Benchmarks that are called example."""

from r2bspec.check.rule_api import Finding, Rule

RULE = Rule(
    code="R2B299",
    title="an example",
    severity="error",
    why="Examples measure nothing.",
    find=lambda context: iter([Finding(message="an example", path=("name",))]),
)
'''


def test_a_validation_rule(package: EditedPackage) -> None:
    (package.folder / "example.r2b.yaml").write_text(SPEC)
    assert package.run("validate", "example.r2b.yaml").returncode == 0
    package.add("r2bspec/check/rules/called_example.py", RULE)
    checked = package.run("validate", "example.r2b.yaml")
    assert (checked.returncode, "R2B299" in checked.stdout) == (1, True), checked.stderr
    assert "Examples measure nothing." in package.run("explain", "R2B299").stdout
    check_files("A validation rule", package)


def test_when_a_late_message_counts_as_lost() -> None:
    waits = {
        str(file.relative_to(ROOT))
        for file in (ROOT / "r2bspec" / "execute").rglob("*.py")
        if re.search(r"^_?\w*DRAIN\w* = ", file.read_text(), re.MULTILINE)
    }
    assert waits == set(RECIPES["When a late message counts as lost"])


RMW = '''
"""An RMW of the test."""

from r2bspec.middleware.middleware import Middleware


class Example(Middleware):
    name = "Example RMW"
    implementations = ("rmw_example_cpp",)
    transports = ("inherit", "udp")


MIDDLEWARE = Example()
'''

SELECTED = """
from r2bspec.middleware.rmw_registry import middleware_of, refuse_transport
found = middleware_of({"RMW_IMPLEMENTATION": "rmw_example_cpp"})
print(found.name, *(refuse_transport(kind, "rmw_example_cpp") is None
                    for kind in ("inherit", "udp", "shared_memory")))
"""


def test_another_rmw(package: EditedPackage) -> None:
    assert "Example RMW" not in package.python(SELECTED)
    package.add("r2bspec/middleware/example.py", RMW)
    assert package.python(SELECTED) == "Example RMW True True False\n"
    check_files("Another RMW", package)


METHOD = '''
"""Requirements that are decided by a coin."""

from r2bspec.judge.decision import Answer, Decider

ANSWER = Answer(outcome="pass", method="coin", reason="Heads.")
DECIDER = Decider(
    takes=lambda question: question.info.name == "missed", decide=lambda question, record: ANSWER
)
'''

JUDGE = """
from pathlib import Path
import msgspec
from r2bspec.judge.judge_samples import judge
from r2bspec.judge.result import Result
from r2bspec.judge.judge_run import from_json, result_of, to_json
from r2bspec.measure.run_samples import read_samples
from report_runs import USUAL
from run_simulation import objective
run = USUAL.write(Path("run"))
verdict = judge({"slo": objective("missed == 0")}, read_samples(run))
result = msgspec.structs.replace(result_of(run), verdict=verdict)
(one,) = from_json(to_json(result)).verdict.requirements
print(one.method, one.reason)
"""


def test_the_method_of_a_verdict(package: EditedPackage) -> None:
    assert package.python(JUDGE).startswith("observation ")
    package.add("r2bspec/judge/methods/coin.py", METHOD)
    package.edit(
        "r2bspec/judge/methods/method_registry.py",
        ('    "none",\n]', '    "coin",\n    "none",\n]'),
        (
            '    "none": MethodTraits(),\n',
            '    "coin": MethodTraits(),\n    "none": MethodTraits(),\n',
        ),
        ("DECIDERS: Final = (\n", 'DECIDERS: Final = (\n    "coin",\n'),
    )
    (package.folder / "run").rename(package.folder / "before")
    assert package.python(JUDGE) == "coin Heads.\n"
    check_files("The method of a verdict", package)


def test_a_report_format(package: EditedPackage) -> None:
    package.add(
        "r2bspec/report/formats/one_word.py",
        "def render(reported):\n    return reported.result.verdict.outcome.encode()\n",
    )
    package.edit(
        "r2bspec/report/format_registry.py",
        (
            '    "json": Format(',
            (
                '    "one_word": Format(f"{_FORMATS_PACKAGE}.one_word", "the outcome"),\n'
                '    "json": Format('
            ),
        ),
    )
    package.python(RENDER_ALL.format(names=("one_word", "json")))
    outcome = json.loads((package.folder / "json").read_text())["verdict"]["outcome"]
    assert (package.folder / "one_word").read_text() == outcome
    assert "one_word" in package.run("report", "--formats").stdout
    written = package.run("report", "run", "--report", "one_word=-")
    assert (written.returncode, written.stdout) == (0, outcome), written.stderr
    check_files("A report format", package)


KIND = """\
BUNDLE: Final = NodeKind(
    name="bundle",
    keys=("bundle",),
    refuses=_NO_CONTAINER,
)

NODE_KINDS: Final = (BUNDLE, """

BUNDLE_KEY = '    bundle: Annotated[str, key("./a.bundle")] = ""\n'

COMMAND_LINE = """\
    "launch": _launch_argv,
    "bundle": lambda wired: (wired.node.bundle, *_ros_arguments(wired, wired.parameters)),
"""

BUNDLED = SPEC.replace(
    "    relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image, output: out}}\n",
    """\
    detector:
      bundle: ./detector.bundle
      parameters: {threshold: 2}
      subscribes: {image: sensor_msgs/msg/Image}
      publishes: {out: sensor_msgs/msg/Image}
""",
)


def test_a_kind_of_node(package: EditedPackage) -> None:
    spec = package.folder / "example.r2b.yaml"
    spec.write_text(BUNDLED)
    assert "R2B101" in package.run("validate", spec.name).stdout
    package.edit(
        "r2bspec/language/node_kinds.py",
        ('"launch", "external"]', '"launch", "external", "bundle"]'),
        ("NODE_KINDS: Final = (", KIND),
    )
    package.edit(
        "r2bspec/language/spec_graph.py",
        ("    external: bool = False\n", f"    external: bool = False\n{BUNDLE_KEY}"),
        (
            "        container: The container",
            "        bundle: A program in one file.\n        container: The container",
        ),
    )
    package.edit("r2bspec/plan/command_lines.py", ('    "launch": _launch_argv,\n', COMMAND_LINE))
    checked = package.run("validate", spec.name)
    assert "no problems" in checked.stdout, checked.stdout
    plan = json.loads(package.run("plan", spec.name).stdout)
    (process,) = [each for each in plan["processes"] if each["name"] == "detector"]
    assert process["role"] == "command"
    assert process["argv"][:2] == ["./detector.bundle", "--ros-args"]
    assert process["argv"][-2:] == ["-p", "threshold:=2"]
    spec.write_text(BUNDLED.replace("bundle: ./", "container: main\n      bundle: ./"))
    refused = package.run("validate", spec.name).stdout
    assert "only Python nodes and plugins run in a container" in refused
    assert "exactly one of 'bundle', 'python'" in package.run("schema", "spec").stdout
    check_files("A kind of node", package)


def test_the_length_of_a_probe(package: EditedPackage) -> None:
    (package.folder / "example.r2b.yaml").write_text(SPEC)
    package.edit(
        "r2bspec/language/probe_length.py",
        ("PROBE: Final = Duration(10 * 10**9)", "PROBE: Final = Duration(4 * 10**9)"),
        ("FIRST_LOOK_S: Final = 1.0", "FIRST_LOOK_S: Final = 2.0"),
        ("MIN_PROBE_STEPS: Final = 20", "MIN_PROBE_STEPS: Final = 7"),
    )
    plan = json.loads(package.run("plan", "example.r2b.yaml").stdout)
    assert plan["search"]["probe_ns"] == 4 * 10**9
    schema = json.loads(package.run("schema", "spec").stdout)
    search = schema["properties"]["benchmark"]["properties"]["search"]
    assert search["properties"]["probe"]["default"] == "4 s"
    looks = package.python(
        "from r2bspec.judge import rate_decision as r; print(r.plan_interim_looks(4)[0].at_s)\n"
        "from r2bspec.execute.measurement import rate_probe\n"
        "print(rate_probe.MIN_PROBE_STEPS, rate_probe.PROBE)"
    )
    assert looks.split("\n")[:2] == ["2.0", "7 4 s"]
    check_files("The length of a probe", package)


def test_an_exit_code(package: EditedPackage) -> None:
    package.edit(
        "r2bspec/exit_status.py",
        ('INCONCLUSIVE = 3, "inconclusive"', 'INCONCLUSIVE = 5, "undecided"'),
        ("USAGE = 2, ", "USAGE = 64, "),
    )
    assert "5 undecided" in " ".join(package.run("--help").stdout.split())
    assert package.run("validate", "nowhere.r2b.yaml").returncode == 64
    assert package.run("plan", "nowhere.r2b.yaml").returncode == 64
    shown = package.python(
        "from r2bspec.judge.verdict import EXIT_CODES; print(int(EXIT_CODES['inconclusive']))"
    )
    assert shown == "5\n"
    check_files("An exit code", package)


STORAGE = '''
"""Each line of a file is the time of a message of one topic."""

from r2bspec.bags.recording import Message
from r2bspec.bags.storage.storage import StoredTopic


class LineStorage:
    def __init__(self, path, display_path):
        self._times = [int(line) for line in path.read_text().split()]
        self.message_count = len(self._times)
        self.topics = (StoredTopic("/ticks", "std_msgs/msg/Empty", "cdr", self.message_count),)
        self.start_ns, self.end_ns = min(self._times), max(self._times)

    def messages(self, names, start_ns, stop_ns):
        for time_ns in self._times:
            yield Message(topic="/ticks", time_ns=time_ns, data=b"\\0\\1\\0\\0\\0")

    def close(self):
        pass
'''

ENTRY = """
    BagFormat(
        name="lines", title="lines", suffix=".lines", reader="lines:LineStorage", note="by lines"
    ),
    BagFormat(
        name="sqlite3","""


def test_a_bag_storage(package: EditedPackage) -> None:
    (package.folder / "run.lines").write_text("10\n20\n30\n")
    assert "neither a bag folder nor a" in package.run("data", "info", "./run.lines").stderr
    package.add("r2bspec/bags/storage/lines.py", STORAGE)
    package.edit(
        "r2bspec/language/bag_formats.py", ('\n    BagFormat(\n        name="sqlite3",', ENTRY)
    )
    found = json.loads(package.run("data", "info", "./run.lines", "--format", "json").stdout)
    assert (found["storage"], found["message_count"], found["notes"]) == ("lines", 3, ["by lines"])
    assert package.run("data", "verify", "run.lines").returncode == 0
    (package.folder / "run.txt").touch()
    assert ".lines" in package.run("data", "info", "./run.txt").stderr
    assert ".lines" in package.run("schema", "spec").stdout
    check_files("A bag storage", package)
