"""What the language server knows of names, nodes and results, through a real client."""

from __future__ import annotations

import ast
import asyncio
import json
import re
import shutil
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
import pytest_lsp
from lsprotocol import types
from pytest_lsp import ClientServerConfig, client_capabilities

import patient_language_server
from open_document import OpenDocument, VersionedClient, edited
from r2bspec.cli.main import main
from report_runs import SIMULATIONS

SPEC = """\
r2bspec: 1
name: simulated
environment: [CELL_PORT]
variables:
  rate: 10 Hz
  threads: 2
containers:
  vision: {executable: python, nice: $(var threads)}
playback:
  inputs:
    image: {from: camera/image, format: sensor_msgs/msg/Image}
data_loader:
  bag: r2b_storage
  topics:
    /d455_1_rgb_image: camera/image
graph:
  nodes:
    relay:
      python: ./nodes.py:Relay
      container: vision
      parameters: {gain: 2.0}
      remappings:
        input: image
        output: copied
monitors:
  copies: {topic: copied, format: sensor_msgs/msg/Image}
benchmark:
  duration: 2 s
  rates: [$(var rate)]
slos:
  fast:
    at: $(var rate)
    require:
      - latency.p90 < 250 ms
      - copies.drop_rate <= 5 %
      - cpu.vision.max < 90 %
"""
NODES = """\
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image


class Relay(Node):
    def __init__(self, **kwargs):
        super().__init__("relay", **kwargs)
        self.declare_parameter("gain", 1.5)
        self.publisher = self.create_publisher(Image, "output", 7)
        self.create_subscription(Image, "input", self.publisher.publish, qos_profile_sensor_data)
"""
UNKNOWN = """\
    other:
      package: cell_vision
      plugin: cell_vision::Detector
      remappings: {found: copied}
monitors:
"""

ERROR = types.DiagnosticSeverity.Error
in_module = pytest.mark.asyncio(loop_scope="module")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace with a node, a parent, an installed package, and a result."""
    folder = tmp_path_factory.mktemp("workspace")
    (folder / "nodes.py").write_text(NODES)
    prefix = folder / "install"
    index = prefix / "share" / "ament_index" / "resource_index"
    for kind, content in (
        ("packages", ""),
        ("rclcpp_components", "cell_vision::Detector;lib/libdetector.so\n"),
        ("rosidl_interfaces", "msg/Found.msg\nmsg/Found.idl\nsrv/Ask.srv\n"),
    ):
        (index / kind).mkdir(parents=True)
        (index / kind / "cell_vision").write_text(content)
    (prefix / "share" / "cell_vision" / "launch").mkdir(parents=True)
    (prefix / "share" / "cell_vision" / "launch" / "cell.launch.py").touch()
    program = prefix / "lib" / "cell_vision" / "detect"
    program.parent.mkdir(parents=True)
    program.touch(0o755)
    SIMULATIONS["usual"].write(folder / "runs" / "simulated-1")
    main(["judge", "--write", str(folder / "runs" / "simulated-1")])
    return folder


@pytest_lsp.fixture(  # type: ignore[untyped-decorator]
    config=ClientServerConfig(
        client_factory=VersionedClient, server_command=patient_language_server.COMMAND
    ),
    scope="module",
)
async def client(lsp_client: VersionedClient, folder: Path) -> AsyncIterator[None]:
    @lsp_client.feature(types.WORKSPACE_CODE_LENS_REFRESH)  # type: ignore[untyped-decorator]
    def refresh(params: None) -> None:
        """An editor would ask for the lenses again."""

    await lsp_client.initialize_session(
        types.InitializeParams(
            capabilities=client_capabilities("visual-studio-code"),
            workspace_folders=[types.WorkspaceFolder(folder.as_uri(), "robot")],
        )
    )
    yield
    await lsp_client.shutdown_session()


@pytest.fixture(scope="module", autouse=True)
def installed(folder: Path) -> Iterator[None]:
    """The server inherits where packages are installed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AMENT_PREFIX_PATH", str(folder / "install"))
        yield


@pytest.fixture
def document(client: VersionedClient, folder: Path) -> Iterator[OpenDocument]:
    document = OpenDocument(client, folder / "robot.r2b.yaml")
    yield document
    document.close()


def changed(old: str, new: str) -> str:
    assert SPEC.count(old) == 1
    return SPEC.replace(old, new)


def line_of(document: OpenDocument, where: types.Range) -> str:
    return document.text.split("\n")[where.start.line].strip()


async def actions(document: OpenDocument, position: types.Position) -> dict[str, types.CodeAction]:
    found = await document.client.text_document_code_action_async(
        types.CodeActionParams(
            document.id, types.Range(position, position), types.CodeActionContext([])
        )
    )
    return {each.title: each for each in found or () if isinstance(each, types.CodeAction)}


@in_module
async def test_the_spec_of_these_tests_has_no_findings(document: OpenDocument) -> None:
    await document.write(SPEC)
    worse = [each for each in document.found().values() if (each.severity or 1) <= 2]
    assert [each.message for each in worse] == []


# What is offered


OFFERED = {
    "topics of the bag with their types": (
        "/d455_1_rgb_image: c",
        "/d¦: c",
        {"/d455_1_imu": "sensor_msgs/msg/Imu"},
    ),
    "topics of the graph with their types": (
        "topic: copied",
        "topic: ¦",
        {"copied": "sensor_msgs/msg/Image"},
    ),
    "what the code of the node names": (
        "        output: copied",
        "        ¦: copied",
        {"output": "sensor_msgs/msg/Image"},
    ),
    "parameters with types and defaults": ("{gain: 2.0}", "{¦}", {"gain": "double, default 1.5"}),
    "the default of a parameter": ("{gain: 2.0}", "{gain: ¦}", {"1.5": "default, double"}),
    "installed packages": (
        "python: ./nodes.py:Relay",
        "package: ¦",
        {"cell_vision": "installed"},
    ),
    "installed plugins": (
        "python: ./nodes.py:Relay",
        "package: cell_vision\n      plugin: ¦",
        {"cell_vision::Detector": "installed"},
    ),
    "installed executables": (
        "python: ./nodes.py:Relay",
        "package: cell_vision\n      executable: ¦",
        {"detect": "installed"},
    ),
    "installed launch files": (
        "python: ./nodes.py:Relay",
        "launch:\n        package: cell_vision\n        file: ¦",
        {"launch/cell.launch.py": "installed"},
    ),
    "plugins of known packages": (
        "python: ./nodes.py:Relay",
        "package: image_proc\n      plugin: ¦",
        {"image_proc::RectifyNode": "known"},
    ),
    "classes of files next to the spec": (
        "python: ./nodes.py:Relay",
        "python: ¦",
        {"./nodes.py:Relay": None},
    ),
    "message types that are installed": (
        "format: sensor_msgs/msg/Image}\nbench",
        "format: ¦}\nbench",
        {"cell_vision/msg/Found": "installed", "sensor_msgs/msg/Image": "of this topic"},
    ),
    "containers": (
        "      container: vision",
        "      container: ¦",
        {"vision": "container"},
    ),
    "datasets": ("bag: r2b_storage", "bag: ¦", {"r2b_cafe": "dataset"}),
    "metrics of processes": ("latency.p90 < 250 ms", "cpu¦", {"cpu.vision.max": "share"}),
    "units after a number": ("latency.p90 < 250 ms", "latency.p90 < 250 ¦", {"ms": "duration"}),
    "a number with its unit": ("duration: 2 s", "duration: 2¦", {"2 ms": "duration"}),
    "a bound of the base version": (
        "latency.p90 < 250 ms",
        "latency.p90 < 105¦",
        {"105 % of baseline": "of the base version"},
    ),
    "variables with their values": (
        "rates: [$(var rate)]",
        "rates: [$(¦",
        {"$(var rate)": "10 Hz"},
    ),
    "names of the environment": (
        "rates: [$(var rate)]",
        "rates: [$(env ¦)]",
        {"CELL_PORT": "of the environment"},
    ),
    "variables of a case": (
        "    at: $(var rate)\n",
        "    when: {¦}\n",
        {"threads": "2"},
    ),
    "codes in waivers": (
        "  rate: 10 Hz",
        "  # r2bspec: ignore[vari¦\n  rate: 10 Hz",
        {"variable-unused": "R2B616"},
    ),
}


@in_module
@pytest.mark.parametrize(("old", "new", "wanted"), OFFERED.values(), ids=OFFERED)
async def test_what_is_offered(
    document: OpenDocument, old: str, new: str, wanted: dict[str, str | None]
) -> None:
    await document.write(SPEC)
    found = await document.labels(changed(old, new))
    assert {name: found[name].detail for name in wanted if name in found} == wanted


@in_module
async def test_values_of_the_cases_of_a_matrix(document: OpenDocument) -> None:
    matrix = "matrix:\n  axes: {threads: [2, 8]}\n  exclude: [{threads: ¦}]\n"
    await document.write(SPEC + matrix.replace("¦", "8"))
    assert {"2", "8"} <= set(await document.labels(SPEC + matrix))
    found = await document.labels(SPEC + matrix.replace("threads: ¦", "¦"))
    assert found["threads"].detail == "2, 8"


@in_module
@pytest.mark.parametrize(
    ("owner", "label", "keys"),
    [
        ("  nodes:\n", "a node", ["python", "remappings"]),
        ("  inputs:\n", "an input", ["from", "format"]),
        ("slos:\n", "an objective", ["at", "require"]),
    ],
)
async def test_snippets(document: OpenDocument, owner: str, label: str, keys: list[str]) -> None:
    await document.write(SPEC)
    indent = " " * (len(owner) - len(owner.lstrip()) + 2)
    found = await document.labels(changed(owner, f"{owner}{indent}¦\n"))
    item = found[label]
    assert item.insert_text_format is types.InsertTextFormat.Snippet
    assert isinstance(item.text_edit, types.TextEdit)
    _, *lines = item.text_edit.new_text.split("\n")
    below = [each for each in lines if each.startswith("  ") and each[2] != " "]
    assert not [each for each in lines if ": ${" in each]
    assert [each.split(":")[0].strip() for each in below] == keys


@in_module
async def test_a_snippet_of_a_whole_spec(document: OpenDocument) -> None:
    found = await document.labels("¦")
    item = found["r2bspec with its keys"]
    assert isinstance(item.text_edit, types.TextEdit)
    assert item.text_edit.new_text.startswith("r2bspec: 1\nname: $1\ndata_loader:\n  bag: $2\n")
    assert "r2bspec" in found


# What is said, and where it is defined


@in_module
@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        (
            "topic: copied",
            "topic: cop¦ied",
            [
                "published by /r2b/relay as `output` (reliable, volatile, depth 7)",
                "subscribed to by monitor",
                "`sensor_msgs/msg/Image`",
            ],
        ),
        (
            "from: camera/image",
            "from: cam¦era/image",
            ["topic `/r2b/camera/image`", "published by loader"],
        ),
        ("at: $(var rate)", "at: $(var ra¦te)", ["`10 Hz`", "(line 5)"]),
        (
            "latency.p90 < 250 ms",
            "latency.p90¦ < 250 ms",
            ["Judged at 10 Hz from 200 steps", "A verdict needs at least 29 messages"],
        ),
    ],
)
async def test_what_is_said(document: OpenDocument, old: str, new: str, wanted: list[str]) -> None:
    position = await document.write(changed(old, new))
    answer = await document.client.text_document_hover_async(
        types.HoverParams(document.id, position)
    )
    assert answer is not None
    assert isinstance(answer.contents, types.MarkupContent)
    said = answer.contents.value
    assert [each for each in wanted if each not in said] == [], said


@in_module
@pytest.mark.parametrize(
    ("old", "new", "lines"),
    [
        ("    at: $(var rate)", "    at: $(var ra¦te)", ["rate: 10 Hz"]),
        (
            "      container: vision",
            "      container: vis¦ion",
            ["vision: {executable: python, nice: $(var threads)}"],
        ),
        (
            "copies.drop_rate",
            "cop¦ies.drop_rate",
            ["copies: {topic: copied, format: sensor_msgs/msg/Image}"],
        ),
        (
            "cpu.vision.max",
            "cpu.vis¦ion.max",
            ["vision: {executable: python, nice: $(var threads)}"],
        ),
    ],
)
async def test_definitions(document: OpenDocument, old: str, new: str, lines: list[str]) -> None:
    position = await document.write(changed(old, new))
    found = await document.client.text_document_definition_async(
        types.DefinitionParams(document.id, position)
    )
    assert isinstance(found, list | tuple)
    assert [line_of(document, each.range) for each in found] == lines


@in_module
async def test_definitions_in_other_files(document: OpenDocument, folder: Path) -> None:
    position = await document.write(changed("./nodes.py:Relay", "./nodes.py:Re¦lay"))
    found = await document.client.text_document_definition_async(
        types.DefinitionParams(document.id, position)
    )
    assert isinstance(found, list | tuple)
    (place,) = found
    assert place.uri == (folder / "nodes.py").as_uri()
    assert NODES.split("\n")[place.range.start.line] == "class Relay(Node):"
    (folder / "base.yaml").write_text("title: A cell\n")
    position = await document.write(changed("r2bspec: 1\n", "r2bspec: 1\nextends: base¦.yaml\n"))
    found = await document.client.text_document_definition_async(
        types.DefinitionParams(document.id, position)
    )
    assert isinstance(found, list | tuple)
    assert [each.uri for each in found] == [(folder / "base.yaml").as_uri()]


@in_module
@pytest.mark.parametrize(
    ("old", "new", "name", "places"),
    [
        ("  rate: 10 Hz", "  ra¦te: 10 Hz", "speed", 3),
        ("    relay:", "    re¦lay:", "copier", 1),
        ("  copies: {topic", "  cop¦ies: {topic", "images", 2),
        ("  vision: {exec", "  vis¦ion: {exec", "cell", 3),
        ("        output: copied", "        output: cop¦ied", "result", 2),
    ],
)
async def test_every_place_of_a_name_is_renamed(
    document: OpenDocument, old: str, new: str, name: str, places: int
) -> None:
    position = await document.write(changed(old, new))
    before = {code for code, each in document.found().items() if (each.severity or 1) <= 2}
    found = await document.client.text_document_references_async(
        types.ReferenceParams(
            types.ReferenceContext(include_declaration=True), document.id, position
        )
    )
    assert len(found or ()) == places
    answer = await document.client.text_document_rename_async(
        types.RenameParams(document.id, position, name)
    )
    assert answer is not None
    assert answer.changes is not None
    changes = answer.changes[document.uri]
    assert len(changes) == places
    await document.write(edited(document.text, changes))
    after = {code for code, each in document.found().items() if (each.severity or 1) <= 2}
    assert after == before


# Findings


@in_module
async def test_a_finding_names_the_related_place(document: OpenDocument) -> None:
    await document.write(
        changed("- latency.p90 < 250 ms", "- latency.p90 < 250 ms\n      - latency.p90 > 300 ms")
    )
    related = [
        line_of(document, place.location.range)
        for each in document.found().values()
        for place in each.related_information or ()
    ]
    assert "- latency.p90 < 250 ms" in related


@in_module
async def test_an_interface_counts_as_it_is_in_the_editor(
    document: OpenDocument, folder: Path
) -> None:
    """It was recorded with another topic; its text in the editor is not saved."""
    (folder / "interfaces").mkdir()
    saved = "publishes: {found: sensor_msgs/msg/Image}\nsubscribes: {}\n"
    (folder / "interfaces" / "other.yaml").write_text(saved)
    await document.write(changed("monitors:\n", UNKNOWN))
    assert not [each for each in document.found().values() if "'found'" in each.message]
    other = OpenDocument(document.client, folder / "interfaces" / "other.yaml")
    document.forget_diagnostics()
    item = types.TextDocumentItem(other.uri, "yaml", 1, saved.replace("found", "detected"))
    document.client.text_document_did_open(types.DidOpenTextDocumentParams(item))
    await document.published()
    said = [each.message for each in document.found().values()]
    assert any("'found'" in each and "detected" in each for each in said), said
    other.close()
    shutil.rmtree(folder / "interfaces")


@in_module
async def test_only_findings_of_the_newest_text_are_shown(document: OpenDocument) -> None:
    """Of twenty texts, one right after the other, what is shown never goes back to an older one."""
    await document.write(SPEC)
    for number in range(20):
        document.version += 1
        wrong = changed("  inputs:\n", f"  mode: number_{number}\n  inputs:\n")
        change = types.TextDocumentContentChangeWholeDocument(wrong)
        versioned = types.VersionedTextDocumentIdentifier(document.version, document.uri)
        document.client.text_document_did_change(
            types.DidChangeTextDocumentParams(versioned, [change])
        )
    shown: list[int] = []
    while 19 not in shown:
        await document.client.wait_for_notification(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        said = "".join(each.message for each in document.client.diagnostics[document.uri])
        shown += map(int, re.findall(r"Unknown choice 'number_(\d+)'", said))
    assert shown == sorted(shown)
    await document.write(SPEC)
    assert not [each for each in document.found().values() if "number_" in each.message]


# What can be done


@in_module
async def test_all_safe_fixes_at_once(document: OpenDocument) -> None:
    text = changed("duration: 2 s", "duration: 2 sec")
    await document.write(text.replace("  inputs:\n", "  mode: Looping\n  inputs:\n"))
    assert [each.severity is ERROR for each in document.found().values()].count(True) == 2
    offered = await actions(document, types.Position(0, 0))
    fix = offered["Apply all safe fixes of this file"]
    assert fix.kind == types.CodeActionKind.SourceFixAll
    assert fix.edit is not None
    assert fix.edit.changes is not None
    await document.write(edited(document.text, fix.edit.changes[document.uri]))
    assert "duration: 2 s\n" in document.text
    assert "mode: looping\n" in document.text


@in_module
async def test_what_a_node_publishes_is_declared(document: OpenDocument) -> None:
    position = await document.write(changed("    relay:", "    rel¦ay:"))
    declared = (await actions(document, position))["Declare what 'relay' publishes"]
    assert declared.edit is not None
    assert declared.edit.changes is not None
    await document.write(edited(document.text, declared.edit.changes[document.uri]))
    assert "      publishes:\n        output: sensor_msgs/msg/Image\n" in document.text
    assert not [each for each in document.found().values() if (each.severity or 1) <= 2]


@in_module
async def test_the_interface_of_an_unknown_node_is_recorded(document: OpenDocument) -> None:
    position = await document.write(changed("monitors:\n", UNKNOWN.replace("other:", "oth¦er:")))
    found = await document.client.text_document_code_action_async(
        types.CodeActionParams(
            document.id, types.Range(position, position), types.CodeActionContext([])
        )
    )
    (record,) = (each for each in found or () if each.title.startswith("Record the interface"))
    # lsprotocol reads an action that has a command, and no edit, as a command with a text.
    command = ast.literal_eval(str(record.command))
    assert command["command"] == "r2bspec.recordInterfaces"
    assert command["arguments"] == [{"file": str(document.path), "case": "", "node": "other"}]


@in_module
async def test_the_last_result_is_a_lens(document: OpenDocument) -> None:
    await document.write(SPEC)
    lenses = await document.client.text_document_code_lens_async(types.CodeLensParams(document.id))
    titles = [each.command.title for each in lenses or () if each.command is not None]
    assert titles[:4] == ["run", "smoke", "plan", "graph"]
    result = json.loads((document.path.parent / "runs/simulated-1/result.json").read_text())
    assert titles[4].startswith("last result: p99 ")
    assert titles[4].endswith(f", {result['verdict']['outcome'].upper()}")
    command = (lenses or ())[4].command
    assert command is not None
    before = len(document.client.shown_documents)
    await document.client.workspace_execute_command_async(
        types.ExecuteCommandParams(command.command, command.arguments)
    )
    while len(document.client.shown_documents) == before:
        await asyncio.sleep(0.02)
    report = Path(document.client.shown_documents[-1].uri.removeprefix("file://"))
    text = report.read_text()
    assert " simulated: " in text.split("\n")[0]
    assert "A simulated run" in text


@in_module
async def test_the_plan_is_shown(document: OpenDocument) -> None:
    document.path.write_text(SPEC)
    await document.write(SPEC)
    before = len(document.client.shown_documents)
    await document.client.workspace_execute_command_async(
        types.ExecuteCommandParams("r2bspec.plan", [{"file": str(document.path)}])
    )
    while len(document.client.shown_documents) == before:
        await asyncio.sleep(0.02)
    file = document.client.shown_documents[-1].uri
    plan = json.loads(Path(file.removeprefix("file://")).read_text())
    assert plan["name"] == "simulated"
