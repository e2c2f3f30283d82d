"""What the language server offers, says and does about a spec, through a real client."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from lsprotocol import types
from pygls.exceptions import JsonRpcException

from open_document import NODES, SPEC, OpenDocument, changed

pytestmark = pytest.mark.asyncio(loop_scope="session")

TABLES = yaml.safe_load(Path(__file__).with_name("features.yaml").read_text(encoding="utf-8"))


def rows(table: str) -> list[Any]:
    """The rows of a table of ``features.yaml``, by their names where they have some."""
    return [
        pytest.param(*(value for key, value in row.items() if key != "what"), id=row.get("what"))
        for row in TABLES[table]
    ]


@pytest.mark.parametrize(("old", "new", "offered"), rows("offered"))
async def test_what_is_offered(
    document: OpenDocument, old: str, new: str, offered: dict[str, str | None]
) -> None:
    await document.write(SPEC)
    items = await document.labels(changed(old, new))
    details = {name: items[name].detail for name in offered if name in items}
    assert details.keys() == offered.keys()
    assert details == {name: text or details[name] for name, text in offered.items()}


def text_edit(item: types.CompletionItem) -> types.TextEdit:
    assert isinstance(item.text_edit, types.TextEdit)
    return item.text_edit


@pytest.mark.parametrize(
    ("owner", "label", "keys"),
    [
        ("  nodes:\n", "a node", ["python", "remappings"]),
        ("  inputs:\n", "an input", ["from", "format"]),
        ("monitors:\n", "a monitor", ["topic", "format"]),
        ("slos:\n", "an objective", ["at", "require"]),
    ],
)
async def test_snippets(document: OpenDocument, owner: str, label: str, keys: list[str]) -> None:
    await document.write(SPEC)
    indent = " " * (len(owner) - len(owner.lstrip()) + 2)
    item = (await document.labels(changed(owner, f"{owner}{indent}¦\n")))[label]
    assert item.insert_text_format is types.InsertTextFormat.Snippet
    _, *lines = text_edit(item).new_text.split("\n")
    below = [line for line in lines if line.startswith("  ") and line[2] != " "]
    assert not [line for line in lines if ": ${" in line]
    assert [line.split(":")[0].strip() for line in below] == keys


async def test_what_is_accepted_replaces_the_word(document: OpenDocument) -> None:
    await document.write(SPEC)
    edit = text_edit((await document.labels(changed("mode: looping", "mo¦")))["mode"])
    assert (document.range_text(edit.range), edit.new_text) == ("mo", "mode: ")


async def test_a_map_has_room_for_its_keys(document: OpenDocument) -> None:
    """The lines of a snippet are indented by the editor, like the line in which it begins."""
    await document.write(SPEC)
    items = await document.labels(changed("    image: {from", "    ¦\n    image: {from"))
    item = items["d455_1_rgb_image"]
    assert text_edit(item).new_text == "d455_1_rgb_image:\n  $0"
    assert item.insert_text_format is types.InsertTextFormat.Snippet
    assert item.insert_text_mode is types.InsertTextMode.AdjustIndentation


@pytest.mark.parametrize(("old", "new", "sentences"), rows("said"))
async def test_what_is_said(
    document: OpenDocument, old: str, new: str, sentences: list[str]
) -> None:
    said = await document.hover(changed(old, new))
    assert [sentence for sentence in sentences if sentence not in said] == [], said


@pytest.mark.parametrize(("old", "new", "line"), rows("defined"))
async def test_definitions(document: OpenDocument, old: str, new: str, line: str) -> None:
    (place,) = await document.definitions(changed(old, new))
    assert document.line_of(place.range) == line


async def test_definitions_in_other_files(document: OpenDocument, folder: Path) -> None:
    (place,) = await document.definitions(changed("./nodes.py:Relay", "./nodes.py:Re¦lay"))
    assert place.uri == (folder / "nodes.py").as_uri()
    assert NODES.split("\n")[place.range.start.line] == "class Relay(Node):"
    (folder / "base.yaml").write_text("title: A cell\n")
    text = changed("r2bspec: 1\n", "r2bspec: 1\nextends: base¦.yaml\n")
    assert [each.uri for each in await document.definitions(text)] == [
        (folder / "base.yaml").as_uri()
    ]


@pytest.mark.parametrize(("old", "new", "name", "places"), rows("renamed"))
async def test_every_place_of_a_name_is_renamed(
    document: OpenDocument, old: str, new: str, name: str, places: int
) -> None:
    position = await document.write(changed(old, new))
    assert document.worse() == []
    found = await document.client.text_document_references_async(
        types.ReferenceParams(
            types.ReferenceContext(include_declaration=True), document.id, position
        )
    )
    assert len(found or ()) == places
    assert await document.apply(await document.rename(position, name)) == places
    assert name in document.text
    assert document.worse() == []


async def test_rename_reaches_the_files_that_are_extended(
    document: OpenDocument, folder: Path
) -> None:
    base = folder / "rates.yaml"
    base.write_text("variables: {rate: 10 Hz}\n")
    text = changed("  rate: 10 Hz\n", "").replace("name:", "extends: rates.yaml\nname:")
    position = await document.write(text.replace("[$(var rate)]", "[$(var ra¦te)]"))
    edit = await document.rename(position, "speed")
    assert edit is not None
    assert edit.changes is not None
    assert {uri: len(edits) for uri, edits in edit.changes.items()} == {
        base.as_uri(): 1,
        document.uri: 2,
    }


async def test_a_name_that_the_code_of_a_node_has_is_not_renamed(
    document: OpenDocument,
) -> None:
    text = changed("        input: image\n", "").replace("    image: {from", "    in¦put: {from")
    position = await document.write(text)
    with pytest.raises(JsonRpcException, match="by the name in its code"):
        await document.rename(position, "other")


async def test_a_finding_names_the_related_place(document: OpenDocument) -> None:
    await document.write(
        changed("- latency.p90 < 250 ms", "- latency.p90 < 250 ms\n      - latency.p90 > 300 ms")
    )
    related = [
        document.line_of(place.location.range)
        for finding in document.found().values()
        for place in finding.related_information or ()
    ]
    assert "- latency.p90 < 250 ms" in related


async def test_a_safe_fix_and_a_waiver_are_offered(document: OpenDocument) -> None:
    await document.write(changed("mode: looping", "mode: Looping"))
    wrong = next(iter(document.found().values()))
    await document.apply((await document.actions(wrong.range))["Replace with 'looping'"].edit)
    assert document.worse() == []
    await document.write(changed("  rate: 10 Hz\n", "  rate: 10 Hz\n  spare: 3\n"))
    offered = await document.actions(document.found()["R2B616"].range)
    await document.apply(offered["Waive R2B616 here, with a reason"].edit)
    assert document.worse() == []


async def test_the_name_that_was_meant_is_offered_before_a_waiver(document: OpenDocument) -> None:
    await document.write(changed("output: copied", "output: copid"))
    wrong = document.found()["R2B207"]
    assert wrong.message.startswith("no publisher on 'copied'")
    offered = await document.actions(wrong.range)
    titles = [each for each in offered if each.startswith(("Replace", "Waive"))]
    assert titles == ["Replace with 'copid'", "Waive R2B207 here, with a reason"]
    await document.apply(offered["Replace with 'copid'"].edit)
    assert document.worse() == []


async def test_all_safe_fixes_at_once(document: OpenDocument) -> None:
    text = changed("duration: 2 s", "duration: 2 sec")
    await document.write(text.replace("mode: looping", "mode: Looping"))
    assert len(document.worse()) == 2
    start = types.Position(0, 0)
    offered = await document.actions(types.Range(start, start))
    fix = offered["Apply all safe fixes of this file"]
    assert fix.kind == types.CodeActionKind.SourceFixAll
    await document.apply(fix.edit)
    assert document.text == SPEC
