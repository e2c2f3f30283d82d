"""How long a change in an editor takes to show, beside a full `r2bspec validate` of the same text.

::

    python benchmarks/bench_language_server.py

A client opens a spec over standard input and output, as an editor does, and changes a few
characters in its middle: a key is wrong after every other change. The time is from the notification
of the change until the client has the diagnostics; it includes the pause of the server in which
further changes are waited for. In the same round the same text is validated in this process, and by
a new process of the command line, which checks every file. Shown are the median and the 95th
percentile.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from lsprotocol import types
from measuring import ROOT, chain_spec, machine, options, show, table
from pytest_lsp import LanguageClient, client_capabilities, make_test_lsp_client

from r2bspec.check.engine import check_cases
from r2bspec.language.load_spec import load_cases
from r2bspec.language_server.server import DEBOUNCE_S

EDITOR = "editor, from change to diagnostics"
FULL = "full validate, in-process"
PROCESS = "full validate, new process"


class Editor:
    """A spec that is open, and its client."""

    def __init__(self, client: LanguageClient, path: Path, text: str) -> None:
        self._client = client
        self._uri = path.as_uri()
        self._version = 0
        self.text = text

    async def open(self) -> None:
        """Open the spec, and wait for its diagnostics."""
        item = types.TextDocumentItem(self._uri, "yaml", self._version, self.text)
        self._client.text_document_did_open(types.DidOpenTextDocumentParams(item))
        await self._diagnostics()

    async def change(self) -> float:
        """Misspell a key in the middle, or correct it; returns seconds until the diagnostics."""
        lines = self.text.split("\n")
        row = next(
            number
            for number, line in enumerate(lines)
            if number > len(lines) // 2 and line.lstrip().startswith(("remappings:", "remapings:"))
        )
        wrong = "remapings" in lines[row]
        old, new = ("remapings", "remappings") if wrong else ("remappings", "remapings")
        column = lines[row].index(old)
        place = types.Range(types.Position(row, column), types.Position(row, column + len(old)))
        lines[row] = lines[row].replace(old, new)
        self.text = "\n".join(lines)
        self._version += 1
        self._client.diagnostics.pop(self._uri, None)
        change = types.TextDocumentContentChangePartial(place, new)
        document = types.VersionedTextDocumentIdentifier(self._version, self._uri)
        start = time.perf_counter()
        self._client.text_document_did_change(types.DidChangeTextDocumentParams(document, [change]))
        found = await self._diagnostics()
        seconds = time.perf_counter() - start
        if wrong == any(each.code == "R2B101" for each in found):
            raise SystemExit("the diagnostics are not those of the text")
        return seconds

    async def _diagnostics(self) -> list[types.Diagnostic]:
        while self._uri not in self._client.diagnostics:
            await self._client.wait_for_notification(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        return list(self._client.diagnostics[self._uri])


def timed(action: Callable[[], object]) -> float:
    """Seconds that an action takes."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def check_text(text: str, path: Path) -> None:
    """A full validate of a text, with everything imported already."""
    check_cases(load_cases(text, file=str(path)))


def validate(path: Path) -> None:
    """A full validate in a process of its own."""
    command = [sys.executable, "-m", "r2bspec", "validate", "--quiet", str(path)]
    ran = subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL, check=False)
    if ran.returncode not in {0, 1}:
        raise SystemExit(f"validate ended with {ran.returncode}")


async def measure(lines: int, repeat: int, folder: Path) -> dict[str, list[float]]:
    """Seconds of each kind, for one length of the spec."""
    client = make_test_lsp_client()
    await client.start_io(sys.executable, "-m", "r2bspec", "lsp")
    found: dict[str, list[float]] = {EDITOR: [], FULL: [], PROCESS: []}
    try:
        await client.initialize_session(
            types.InitializeParams(
                capabilities=client_capabilities("visual-studio-code"),
                workspace_folders=[types.WorkspaceFolder(folder.as_uri(), "robot")],
            )
        )
        path = folder / f"lines_{lines}.r2b.yaml"
        editor = Editor(client, path, chain_spec(lines // 10))
        await editor.open()
        for round_number in range(repeat + 2):
            seconds = await editor.change()
            text = editor.text
            path.write_text(text, encoding="utf-8")
            full = timed(partial(check_text, text, path))
            process = timed(partial(validate, path))
            if round_number > 1:
                for name, value in ((EDITOR, seconds), (FULL, full), (PROCESS, process)):
                    found[name].append(value)
        await client.shutdown_session()
    finally:
        await client.stop()  # type: ignore[no-untyped-call]
    return found


def rows(cases: dict[int, dict[str, list[float]]]) -> Iterator[list[str]]:
    """The measured times of each length."""
    for lines, found in cases.items():
        cells = [
            f"{statistics.median(each) * 1e3:.0f}, "
            f"{statistics.quantiles(each, n=20)[-1] * 1e3:.0f} ms"
            for each in found.values()
        ]
        yield [f"{lines:,} lines", *cells]


def main() -> None:
    """Measure, and print what was measured."""
    parser = options(__doc__)
    parser.add_argument("--repeat", type=int, default=60, help="changes of each spec")
    given = parser.parse_args()
    os.environ["PYTHONPATH"] = str(ROOT)
    with tempfile.TemporaryDirectory() as name:
        cases = {
            lines: asyncio.run(measure(lines, given.repeat, Path(name))) for lines in (200, 2000)
        }
    show(
        f"{machine()}, {given.repeat} changes each; median, 95th percentile; "
        f"the server waits {DEBOUNCE_S * 1e3:.0f} ms of it.",
        "",
        *table(("spec", EDITOR, FULL, PROCESS), rows(cases)),
    )


if __name__ == "__main__":
    main()
