"""The language server through a real client: which text counts, what is shown, and commands."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from lsprotocol import types

from open_document import SPEC, UNKNOWN, OpenDocument, VersionedClient, changed, path_of

pytestmark = pytest.mark.asyncio(loop_scope="session")


async def test_findings_are_diagnostics_with_a_link_and_a_tag(document: OpenDocument) -> None:
    await document.write(changed("  rate: 10 Hz\n", "  rate: 10 Hz\n  unused: 3\n"))
    unused = document.found()["R2B616"]
    assert document.range_text(unused.range) == "unused"
    assert unused.severity is types.DiagnosticSeverity.Warning
    assert list(unused.tags or ()) == [types.DiagnosticTag.Unnecessary]
    assert unused.code_description is not None
    page = path_of(unused.code_description.href).read_text()
    assert "R2B616" in page
    assert "variables: {rate: 30 Hz}" in page


async def test_the_unsaved_text_counts_and_what_is_mended_is_gone(
    document: OpenDocument,
) -> None:
    document.path.write_text("no spec at all")
    await document.write(changed("mode: looping", "mode: loping"))
    assert any("loping" in message for message in document.worse())
    await document.write(SPEC)
    assert document.worse() == []


async def test_columns_are_those_of_the_editor(document: OpenDocument) -> None:
    """A character outside of the basic plane is one column for us, and two for the protocol."""
    await document.write(changed("name: simulated", 'name: simulated\ntitle: "🤖🤖", x: 1'))
    assert document.found()
    await document.write(
        changed("    image: {from", '    # 🤖\n    "image": {description: "🤖", form')
    )
    (wrong,) = (each.range for each in document.found().values() if "form" in each.message)
    line = document.text.split("\n")[wrong.start.line].encode("utf-16-le")
    text = line[2 * wrong.start.character : 2 * wrong.end.character]
    assert text.decode("utf-16-le") == "form"


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
    other.change(saved.replace("found", "detected"))
    await document.published()
    said = [each.message for each in document.found().values()]
    assert any("'found'" in message and "detected" in message for message in said), said
    other.close()
    shutil.rmtree(folder / "interfaces")


async def test_the_findings_of_a_document_end_when_it_is_closed(
    document: OpenDocument, folder: Path
) -> None:
    other = OpenDocument(document.client, folder / "other.r2b.yaml")
    await other.write("r2bspec: 1\n")
    assert other.worse()
    other.close()
    while document.client.diagnostics[other.uri]:
        await document.client.wait_for_notification(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)


async def cases_of(client: VersionedClient, uri: str) -> object:
    send = client.protocol.send_request_async
    return await send("r2bspec/cases", {"uri": uri})  # type: ignore[no-untyped-call]


async def test_the_cases_of_a_spec_are_told_of_a_file_that_is_not_open(
    client: VersionedClient, tmp_path: Path
) -> None:
    path = tmp_path / "relay.r2b.yaml"
    matrix = "matrix: {axes: {rate: [10 Hz, 20 Hz]}}\n"
    path.write_text(SPEC.replace("r2bspec: 1\n", "# a comment\nr2bspec: 1\n" + matrix))
    assert await cases_of(client, path.as_uri()) == [
        {"name": f"simulated[rate={rate} Hz]", "case": f"rate={rate} Hz", "line": 3}
        for rate in (10, 20)
    ]


async def test_the_cases_of_an_open_spec_are_those_of_its_text(document: OpenDocument) -> None:
    await document.write(changed("name: simulated", "name: other"))
    assert await cases_of(document.client, document.uri) == [
        {"name": "other", "case": "", "line": 1}
    ]
