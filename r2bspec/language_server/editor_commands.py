"""The commands that the server runs for an editor: each is the command line, in a process.

An editor that has a terminal may register the same names and run them itself.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from lsprotocol import types

RUN: Final = "r2bspec.run"
SMOKE: Final = "r2bspec.smoke"
PLAN: Final = "r2bspec.plan"
DRAW_GRAPH: Final = "r2bspec.drawGraph"
RECORD_INTERFACES: Final = "r2bspec.recordInterfaces"
SHOW_RESULT: Final = "r2bspec.showResult"
"""Its argument is a run folder, and not a spec."""
COMMANDS: Final = (RUN, SMOKE, PLAN, DRAW_GRAPH, RECORD_INTERFACES)


@dataclass(frozen=True, slots=True)
class SpecCommand:
    """What a command is about: the argument that editors send back.

    Attributes:
        file: of the spec.
        case: of its matrix; empty without one.
        node: only this one; empty for all.
    """

    file: str
    case: str = ""
    node: str = ""

    def as_command(self, title: str, name: str) -> types.Command:
        """The command for an editor."""
        return types.Command(title, name, arguments=[asdict(self)])

    @classmethod
    def from_argument(cls, argument: Mapping[str, Any]) -> SpecCommand:
        """The command that an editor sent.

        Raises:
            ValueError: it is none.
        """
        texts = {key: str(argument.get(key, "")) for key in ("file", "case", "node")}
        if not texts["file"] or not Path(texts["file"]).is_absolute():
            raise ValueError("the command needs the absolute path of a spec as 'file'")
        return cls(**texts)

    def argv(self, name: str) -> list[str]:
        """The words of the command line."""
        case = ["--case", self.case] if self.case else []
        verbs = {
            RUN: ["run", self.file, *case],
            SMOKE: ["run", "--smoke", self.file, *case],
            PLAN: ["plan", self.file, *case],
            DRAW_GRAPH: ["plan", "--graph", "mermaid", self.file, *case],
            RECORD_INTERFACES: [
                "interfaces",
                self.file,
                *(["--node", self.node] if self.node else []),
                *case,
            ],
        }
        return [sys.executable, "-P", "-m", "r2bspec", *verbs[name]]


def report_argv(folder: str) -> list[str]:
    """The words of the command line that prints the report of a run.

    Raises:
        ValueError: the folder is none of a run.
    """
    if not Path(folder).is_absolute() or not (Path(folder) / "result.json").is_file():
        raise ValueError("the command needs the absolute path of a run folder")
    return [sys.executable, "-P", "-m", "r2bspec", "report", folder, "--report", "markdown=-"]


async def run_command(
    argv: list[str], folder: Path, on_line: Callable[[str], None]
) -> tuple[int, str]:
    """Run a command line; a cancelled one is ended in order, as with Ctrl-C.

    Args:
        argv: its words.
        folder: in which it runs.
        on_line: is called with every line of its progress.

    Returns:
        The exit status, and what it printed on standard output.
    """
    process = await asyncio.create_subprocess_exec(
        *argv,
        cwd=folder,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        limit=1 << 20,
    )
    try:
        _, output = await asyncio.gather(_tell(process.stderr, on_line), _all(process.stdout))
        return await process.wait(), output
    except asyncio.CancelledError:
        process.send_signal(2)
        await process.wait()
        raise


async def _tell(stream: asyncio.StreamReader | None, on_line: Callable[[str], None]) -> None:
    while stream is not None and (line := await stream.readline()):
        on_line(line.decode("utf-8", "replace").rstrip())


async def _all(stream: asyncio.StreamReader | None) -> str:
    return "" if stream is None else (await stream.read()).decode("utf-8", "replace")
