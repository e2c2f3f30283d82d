"""The language server through a real client, over standard input and output."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest
import pytest_lsp
from lsprotocol import types
from pygls.exceptions import JsonRpcException
from pytest_lsp import ClientServerConfig, client_capabilities

from open_document import OpenDocument, VersionedClient, edited

SPEC = """\
r2bspec: 1
name: relay
variables:
  rate: 10 Hz
playback:
  mode: looping
  inputs:
    image: {from: camera/image, format: sensor_msgs/msg/Image}
data_loader:
  bag: r2b_storage
  window: {start: 0.0 s, end: 0.5 s}
  topics:
    /d455_1_rgb_image: camera/image
graph:
  nodes:
    relay:
      python: r2bspec.nodes.RelayNode
      parameters: {service_time_ms: 1.0}
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
"""


refreshes: list[None] = []


@pytest_lsp.fixture(  # type: ignore[untyped-decorator]
    config=ClientServerConfig(
        client_factory=VersionedClient, server_command=[sys.executable, "-m", "r2bspec", "lsp"]
    ),
    scope="module",
)
async def client(
    lsp_client: VersionedClient, tmp_path_factory: pytest.TempPathFactory
) -> AsyncIterator[None]:
    folder = tmp_path_factory.mktemp("workspace")

    @lsp_client.feature(types.WORKSPACE_CODE_LENS_REFRESH)  # type: ignore[untyped-decorator]
    def refresh(params: None) -> None:
        """An editor would ask for the lenses again."""
        refreshes.append(params)

    await lsp_client.initialize_session(
        types.InitializeParams(
            capabilities=client_capabilities("visual-studio-code"),
            workspace_folders=[types.WorkspaceFolder(folder.as_uri(), "robot")],
        )
    )
    yield
    await lsp_client.shutdown_session()


@pytest.fixture
def document(client: VersionedClient, tmp_path: Path) -> Iterator[OpenDocument]:
    document = OpenDocument(client, tmp_path / "robot.r2b.yaml")
    yield document
    document.close()


def changed(old: str, new: str) -> str:
    assert SPEC.count(old) == 1
    return SPEC.replace(old, new)


in_module = pytest.mark.asyncio(loop_scope="module")


@in_module
async def test_findings_are_diagnostics_with_a_link_and_a_tag(document: OpenDocument) -> None:
    await document.write(changed("  rate: 10 Hz\n", "  rate: 10 Hz\n  unused: 3\n"))
    found = document.found()
    unused = found["R2B616"]
    assert document.range_text(unused.range) == "unused"
    assert unused.severity is types.DiagnosticSeverity.Warning
    assert unused.tags == (types.DiagnosticTag.Unnecessary,) or list(unused.tags or ()) == [
        types.DiagnosticTag.Unnecessary
    ]
    assert unused.code_description is not None
    page = Path(unquote(urlparse(unused.code_description.href).path)).read_text()
    assert "R2B616" in page
    assert "variables: {rate: 30 Hz}" in page


@in_module
async def test_the_unsaved_text_counts_and_what_is_mended_is_gone(
    document: OpenDocument,
) -> None:
    document.path.write_text("no spec at all")
    await document.write(changed("mode: looping", "mode: loping"))
    assert "R2B104" in document.found() or "R2B103" in document.found() or document.found()
    assert any("loping" in each.message for each in document.found().values())
    await document.write(SPEC)
    assert document.found() == {}


@in_module
async def test_columns_are_those_of_the_editor(document: OpenDocument) -> None:
    """A character outside of the basic plane is one column for us, and two for the protocol."""
    await document.write(changed("name: relay", 'name: relay\ntitle: "🤖🤖", x: 1'))
    assert document.found()
    await document.write(
        changed("    image: {from", '    # 🤖\n    "image": {description: "🤖", form')
    )
    wrong = [each for each in document.found().values() if "form" in each.message]
    assert [document_text(document, each.range) for each in wrong] == ["form"]


def document_text(document: OpenDocument, where: types.Range) -> str:
    line = document.text.split("\n")[where.start.line].encode("utf-16-le")
    return line[2 * where.start.character : 2 * where.end.character].decode("utf-16-le")


@in_module
async def test_a_parent_counts_as_it_is_in_the_editor(
    client: VersionedClient, tmp_path: Path
) -> None:
    base, child = tmp_path / "base.yaml", tmp_path / "child.r2b.yaml"
    base.write_text("variables: {rate: 10 Hz}\n")
    document = OpenDocument(client, child)
    text = changed("variables:\n  rate: 10 Hz\n", "extends: base.yaml\n")
    await document.write(text)
    assert document.found() == {}
    parent = OpenDocument(client, base)
    parent.version = 1
    item = types.TextDocumentItem(parent.uri, "yaml", 1, "variables: {rate: 10 Hz, rate: 5 Hz}\n")
    client.text_document_did_open(types.DidOpenTextDocumentParams(item))
    while not client.diagnostics.get(parent.uri):
        await client.wait_for_notification(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
    assert "rate" in client.diagnostics[parent.uri][0].message
    client.text_document_did_close(types.DidCloseTextDocumentParams(parent.id))


@in_module
@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("  mode: looping", "  ¦", {"mode", "buffer"}),
        ("mode: looping", "mode: ¦", {"looping", "sweeping", "timeline", "live"}),
        ("/d455_1_rgb_image: c", "/d¦: c", {"/d455_1_rgb_image", "/d455_1_imu"}),
        ("bag: r2b_storage", "bag: ¦", {"r2b_storage", "r2b_cafe"}),
        ("topic: copied", "topic: ¦", {"copied", "image"}),
        ("format: sensor_msgs/msg/Image}\nbench", "format: ¦}\nbench", {"sensor_msgs/msg/Image"}),
        ("{service_time_ms: 1.0}", "{ser¦}", {"service_time_ms", "queue_depth"}),
        ("input: image", "¦: image", {"input"}),
        ("rates: [$(var rate)]", "rates: [$(var ¦)]", {"rate"}),
        ("    at: $(var rate)", "    at: ¦", {"10 Hz"}),
        (
            "latency.p90 < 250 ms",
            "lat¦",
            {"latency.p90", "copies.latency.p90"} - {"copies.latency.p90"},
        ),
        ("latency.p90 < 250 ms", "latency.p90 < ¦", {"50 ms"}),
        ("latency.p90 < 250 ms", "latency.p90 ¦", {"<", "<="}),
        ("python: r2bspec.nodes.RelayNode", "python: ¦", {"r2bspec.nodes.RelayNode"}),
        (
            "name: relay",
            "name: relay # r2bspec: ignore[¦",
            {"variable-unused", "R2B616"} - {"variable-unused"},
        ),
        ("monitors:\n", "monitors:\n  ¦\n", {"a monitor"}),
    ],
)
async def test_completion(document: OpenDocument, old: str, new: str, wanted: set[str]) -> None:
    await document.write(SPEC)
    assert wanted <= set(await document.labels(changed(old, new)))


@in_module
async def test_what_is_accepted_replaces_the_word(document: OpenDocument) -> None:
    await document.write(SPEC)
    found = await document.labels(changed("mode: looping", "mo¦"))
    edit = found["mode"].text_edit
    assert isinstance(edit, types.TextEdit)
    assert document.range_text(edit.range) == "mo"
    assert edit.new_text == "mode: "


@in_module
async def test_a_map_has_room_for_its_keys(document: OpenDocument) -> None:
    """The lines of a snippet are indented by the editor, like the line in which it begins."""
    await document.write(SPEC)
    found = await document.labels(SPEC.replace("    image: {from", "    ¦\n    image: {from"))
    item = found["d455_1_rgb_image"]
    assert isinstance(item.text_edit, types.TextEdit)
    assert item.text_edit.new_text == "d455_1_rgb_image:\n  from: $1\n  format: $2"
    assert item.insert_text_format is types.InsertTextFormat.Snippet
    assert item.insert_text_mode is types.InsertTextMode.AdjustIndentation


@in_module
async def test_keys_that_begin_on_the_line_of_their_map(document: OpenDocument) -> None:
    """They are written below it, as YAML needs it."""
    await document.write(SPEC)
    found = await document.labels(f"{SPEC}transport: ¦\n")
    item = found["segment"]
    assert isinstance(item.text_edit, types.TextEdit)
    assert item.text_edit.new_text.startswith("\n  segment:")
    assert "inherit" in found


@in_module
async def test_a_whole_spec_is_written_with_completion_alone(document: OpenDocument) -> None:
    """From an empty text, with what is offered at each place, to a spec without errors."""
    text = "r2bspec: 1\nname: written\n"
    for typed, label in WRITTEN:
        found = await document.labels(f"{text}{typed}¦\n")
        assert label in found, (typed, sorted(found))
        edit = found[label].text_edit
        assert isinstance(edit, types.TextEdit)
        text = edited(text + typed, [edit])
    await document.write(f"{text} < 250 ms\n")
    assert {code: each.message for code, each in document.found().items()} == {}


@in_module
async def test_hover(document: OpenDocument) -> None:
    async def said(old: str, new: str) -> str:
        position = await document.write(changed(old, new))
        answer = await document.client.text_document_hover_async(
            types.HoverParams(document.id, position)
        )
        assert answer is not None
        assert isinstance(answer.contents, types.MarkupContent)
        return answer.contents.value

    assert "duration of one iteration" in await said("duration: 2 s", "dura¦tion: 2 s")
    topic = await said("topic: copied", "topic: cop¦ied")
    assert "published by /r2b/relay" in topic
    assert "sensor_msgs/msg/Image" in topic
    value = await said("rates: [$(var rate)]", "rates: [$(var ra¦te)]")
    assert "10 Hz" in value
    assert "line" in value
    requirement = await said("latency.p90 < 250 ms", "latency.p¦90 < 250 ms")
    assert "needs at least" in requirement
    assert "Formula" in requirement


@in_module
async def test_definition_references_and_rename_of_a_topic(document: OpenDocument) -> None:
    position = await document.write(changed("topic: copied", "topic: cop¦ied"))
    where = types.TextDocumentPositionParams(document.id, position)
    defined = await document.client.text_document_definition_async(
        types.DefinitionParams(where.text_document, where.position)
    )
    assert isinstance(defined, list | tuple)
    assert [document.text.split("\n")[each.range.start.line].strip() for each in defined] == [
        "output: copied"
    ]
    edit = await document.client.text_document_rename_async(
        types.RenameParams(document.id, position, "result")
    )
    assert edit is not None
    assert edit.changes is not None
    assert len(edit.changes[document.uri]) == 2
    await document.write(edited(document.text, edit.changes[document.uri]))
    assert document.found() == {}
    assert "topic: result" in document.text


@in_module
async def test_rename_reaches_the_files_that_are_extended(
    client: VersionedClient, tmp_path: Path
) -> None:
    base, child = tmp_path / "base.yaml", tmp_path / "child.r2b.yaml"
    base.write_text("variables: {rate: 10 Hz}\n")
    document = OpenDocument(client, child)
    text = changed("variables:\n  rate: 10 Hz\n", "extends: base.yaml\n")
    position = await document.write(text.replace("[$(var rate)]", "[$(var ra¦te)]"))
    edit = await client.text_document_rename_async(
        types.RenameParams(document.id, position, "speed")
    )
    assert edit is not None
    assert edit.changes is not None
    assert {uri: len(edits) for uri, edits in edit.changes.items()} == {
        base.as_uri(): 1,
        document.uri: 2,
    }


@in_module
async def test_a_name_that_the_code_of_a_node_has_is_not_renamed(
    document: OpenDocument,
) -> None:
    text = changed("        input: image\n", "").replace("    image: {from", "    in¦put: {from")
    position = await document.write(text)
    with pytest.raises(JsonRpcException, match="by the name in its code"):
        await document.client.text_document_rename_async(
            types.RenameParams(document.id, position, "other")
        )


@in_module
async def test_a_safe_fix_and_a_waiver_are_offered(document: OpenDocument) -> None:
    await document.write(changed("mode: looping", "mode: Looping"))
    wrong = next(iter(document.found().values()))
    actions = await document.client.text_document_code_action_async(
        types.CodeActionParams(document.id, wrong.range, types.CodeActionContext([wrong]))
    )
    assert actions is not None
    by_title = {each.title: each for each in actions if isinstance(each, types.CodeAction)}
    fix = by_title["Replace with 'looping'"]
    assert fix.edit is not None
    assert fix.edit.changes is not None
    await document.write(edited(document.text, fix.edit.changes[document.uri]))
    assert document.found() == {}
    await document.write(changed("  rate: 10 Hz\n", "  rate: 10 Hz\n  spare: 3\n"))
    unused = document.found()["R2B616"]
    actions = await document.client.text_document_code_action_async(
        types.CodeActionParams(document.id, unused.range, types.CodeActionContext([unused]))
    )
    waiver = next(each for each in actions or () if each.title.startswith("Waive R2B616"))
    assert isinstance(waiver, types.CodeAction)
    assert waiver.edit is not None
    assert waiver.edit.changes is not None
    await document.write(edited(document.text, waiver.edit.changes[document.uri]))
    assert document.found() == {}


@in_module
async def test_the_outline_folds_and_selections(document: OpenDocument) -> None:
    position = await document.write(changed("duration: 2 s", "duration: 2¦ s"))
    symbols = await document.client.text_document_document_symbol_async(
        types.DocumentSymbolParams(document.id)
    )
    names = [each.name for each in symbols or ()]
    assert names[:2] == ["r2bspec", "name"]
    assert "graph" in names
    folds = await document.client.text_document_folding_range_async(
        types.FoldingRangeParams(document.id)
    )
    lines = document.text.split("\n")
    assert "graph:" in {lines[each.start_line] for each in folds or ()}
    selections = await document.client.text_document_selection_range_async(
        types.SelectionRangeParams(document.id, [position])
    )
    assert selections is not None
    assert document.range_text(selections[0].range) == "2 s"
    assert selections[0].parent is not None


@in_module
async def test_hints_and_lenses(document: OpenDocument) -> None:
    await document.write(SPEC)
    everything = types.Range(types.Position(0, 0), types.Position(100, 0))
    hints = await document.client.text_document_inlay_hint_async(
        types.InlayHintParams(document.id, everything)
    )
    said = [str(each.label) for each in hints or ()]
    assert "20 steps x 10" in said
    assert any(each.startswith("a run takes about") for each in said)
    lenses = await document.client.text_document_code_lens_async(types.CodeLensParams(document.id))
    titles = [each.command.title for each in lenses or () if each.command is not None]
    assert titles[:3] == ["run", "smoke", "plan"]


@in_module
async def test_a_new_result_on_disk_refreshes_the_lenses(document: OpenDocument) -> None:
    before = len(refreshes)
    result = document.path.parent / "runs" / "relay-1" / "result.json"
    created = types.FileEvent(result.as_uri(), types.FileChangeType.Created)
    document.client.workspace_did_change_watched_files(types.DidChangeWatchedFilesParams([created]))
    while len(refreshes) == before:
        await asyncio.sleep(0.02)


@in_module
async def test_a_command_runs_the_command_line(document: OpenDocument) -> None:
    document.path.write_text(SPEC)
    await document.write(SPEC)
    await document.client.workspace_execute_command_async(
        types.ExecuteCommandParams("r2bspec.drawGraph", [{"file": str(document.path)}])
    )
    while "flowchart" not in shown_text(document.client):
        await asyncio.sleep(0.02)


async def cases_of(client: VersionedClient, uri: str) -> object:
    send = client.protocol.send_request_async
    return await send("r2bspec/cases", {"uri": uri})  # type: ignore[no-untyped-call]


@in_module
async def test_the_cases_of_a_spec_are_told_of_a_file_that_is_not_open(
    client: VersionedClient, tmp_path: Path
) -> None:
    path = tmp_path / "relay.r2b.yaml"
    matrix = "matrix: {axes: {rate: [10 Hz, 20 Hz]}}\n"
    path.write_text(SPEC.replace("r2bspec: 1\n", "# a comment\nr2bspec: 1\n" + matrix))
    found = await cases_of(client, path.as_uri())
    assert found == [
        {"name": "relay[rate=10 Hz]", "case": "rate=10 Hz", "line": 3},
        {"name": "relay[rate=20 Hz]", "case": "rate=20 Hz", "line": 3},
    ]


@in_module
async def test_the_cases_of_an_open_spec_are_those_of_its_text(document: OpenDocument) -> None:
    await document.write(changed("name: relay", "name: other"))
    found = await cases_of(document.client, document.uri)
    assert found == [{"name": "other", "case": "", "line": 1}]


@in_module
async def test_a_command_without_a_file_is_refused(client: VersionedClient) -> None:
    with pytest.raises(JsonRpcException, match="absolute path"):
        await client.workspace_execute_command_async(
            types.ExecuteCommandParams("r2bspec.run", [{"file": "relative.yaml"}])
        )


@in_module
@pytest.mark.parametrize(
    "text", ["", "\ufeff", "a: [", "- x\n- y", "🤖", "x: &a [*a]", "\t", "r2bspec: 1\n%"]
)
async def test_no_text_is_too_broken(client: VersionedClient, tmp_path: Path, text: str) -> None:
    """Requests about any text have an answer, and the server goes on."""
    path = tmp_path / "broken.r2b.yaml"
    uri = path.as_uri()
    client.text_document_did_open(
        types.DidOpenTextDocumentParams(types.TextDocumentItem(uri, "yaml", 1, text))
    )
    document, start = types.TextDocumentIdentifier(uri), types.Position(0, 0)
    await client.text_document_completion_async(types.CompletionParams(document, start))
    await client.text_document_hover_async(types.HoverParams(document, start))
    await client.text_document_document_symbol_async(types.DocumentSymbolParams(document))
    await client.text_document_code_lens_async(types.CodeLensParams(document))
    client.text_document_did_close(types.DidCloseTextDocumentParams(document))


def shown_text(client: VersionedClient) -> str:
    """What the server has logged or shown as a document."""
    files = [Path(unquote(urlparse(each.uri).path)) for each in client.shown_documents]
    said = [each.message for each in client.log_messages]
    return "\n".join([*said, *(each.read_text() for each in files)])


WRITTEN = (
    ("data_loader:\n  ", "bag"),
    ("", "r2b_storage"),
    ("\n  topics:\n    ", "/d455_1_rgb_image"),
    ("camera/image\ngraph:\n  nodes:\n    relay:\n      ", "python"),
    ("", "r2bspec.nodes.RelayNode"),
    ("\n      remappings:\n        ", "output"),
    ("copied\nplayback:\n  inputs:\n    input:\n      ", "from"),
    ("", "camera/image"),
    ("\n      ", "format"),
    ("", "sensor_msgs/msg/Image"),
    ("\nmonitors:\n  copies:\n    ", "topic"),
    ("", "copied"),
    ("\n    ", "format"),
    ("", "sensor_msgs/msg/Image"),
    ("\nbenchmark:\n  ", "duration"),
    ("", "2.5 s"),
    ("\n  ", "rates"),
    ("[10 Hz]\nslos:\n  fast:\n    ", "at"),
    ("", "10 Hz"),
    ("\n    require:\n      - ", "latency.p90"),
)
"""What a user types before each proposal that is accepted; names of one's own have no proposal."""
