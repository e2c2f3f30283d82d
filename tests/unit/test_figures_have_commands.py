"""Every table of figures in the documentation names the command that prints it, and it exists.

After a table of which over a third of the cells are figures comes one of these, in the next lines:

    Printed by `COMMAND`.
    Not printed again: measured on DATE, on MACHINE; WHY.

On the pages of measurements, a section with figures in its prose has one of these, too, or says in
a comment which module states the figures, because they are limits or formulas and no results:

    <!-- stated: FILE -->
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = (*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md")

LEAST_SHARE = 1 / 3
FIGURE = re.compile(r"^[≤≥<>~±+-]?\d[\d.,]*(\s*([/,…x%-]|to\b|[a-zµ]).*)?$", re.IGNORECASE)
NOT_MEASURED = re.compile(r"exit|code|status|files", re.IGNORECASE)
PRINTED = re.compile(r"Printed by `([^`]+)`")
ONCE = re.compile(r"Not printed again: measured (?:on|in) \d{4}-\d{2}(?:-\d{2})?, on \S")
NEAR = 5
"""Lines after a table that are not empty."""


@dataclass(frozen=True)
class Table:
    """A table of figures: where it is, and the lines after it."""

    page: str
    line: int
    after: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def tables(page: Path) -> Iterator[Table]:
    """The tables of figures of a page."""
    lines = page.read_text().splitlines()
    number = 0
    while number < len(lines):
        end = number
        while end < len(lines) and lines[end].startswith("|"):
            end += 1
        if end > number + 2 and _has_figures(lines[number:end]):
            after = [each for each in lines[end : end + 3 * NEAR] if each.strip()][:NEAR]
            yield Table(page.name, number + 1, "\n".join(after))
        number = max(end, number + 1)


def _has_figures(lines: list[str]) -> bool:
    head, _, *rows = ([cell.strip() for cell in each.strip("|").split("|")] for each in lines)
    measured = [
        number for number, name in enumerate(head) if number and not NOT_MEASURED.search(name)
    ]
    cells = [row[number] for row in rows for number in measured if number < len(row)]
    return bool(cells) and sum(map(bool, map(FIGURE.match, cells))) > LEAST_SHARE * len(cells)


MEASURED = ("host_interference.md", "peak_throughput.md", "performance.md", "verdicts.md")
PROSE_FIGURE = re.compile(r"(?<![\w.])\d[\d.,]*\s*(%|(ms|us|s|Hz|times|MiB|KiB|cores?|minutes)\b)")
STATED = re.compile(r"<!-- stated: (\S+) -->")


@dataclass(frozen=True)
class Section:
    """A section of a page, with figures in its prose."""

    page: str
    heading: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}: {self.heading}"


def sections(name: str) -> Iterator[Section]:
    """The sections of a page that have figures outside of tables, code and headings."""
    for text in re.split(r"(?m)^(?=#)", (ROOT / "docs" / name).read_text()):
        lines = [each for each in text.splitlines() if not each.startswith(("|", "    ", "#"))]
        prose = re.sub(r"`[^`]*`", "", "\n".join(lines))
        if PROSE_FIGURE.search(prose):
            yield Section(name, text.splitlines()[0].lstrip("# "), text)


SECTIONS = [section for name in MEASURED for section in sections(name)]


TABLES = [table for page in PAGES for table in tables(page)]


def problem(command: str) -> str:
    """What of a command does not exist; empty if all of it does."""
    words = [each for each in shlex.split(command) if not re.match(r"^[A-Z_]+=", each)]
    if words[0] == "make":
        options = re.findall(r"BENCH=(\S+)", command)
        script = ROOT / "tests/bench/harness_floor.py"
        targets = (ROOT / "Makefile").read_text()
        if not re.search(rf"^{words[1]}:", targets, re.MULTILINE):
            return f"no target {words[1]}"
        return _missing(script, options)
    if words[0] != "python":
        return f"{words[0]} is neither make nor python"
    script = ROOT / words[1]
    if not script.is_file():
        return f"no file {words[1]}"
    return _missing(script, words[2:])


def _missing(script: Path, words: list[str]) -> str:
    """Which option, or which table of the script, it does not have."""
    text = script.read_text()
    if script.name == "tables.py":
        # It also prints those of this module, as `START_TABLES`.
        text += (script.parent / "start_tables.py").read_text()
    for each in words:
        if each.startswith("--"):
            if f'"{each.partition("=")[0]}"' not in text:
                return f"{script.name} has no {each}"
        elif script.name.endswith("tables.py") and f"def {each}(" not in text:
            return f"{script.name} has no table {each}"
    return ""


def test_there_are_tables_of_figures() -> None:
    assert len(TABLES) > 10


@pytest.mark.parametrize("table", TABLES, ids=str)
def test_a_table_of_figures_names_the_command_that_prints_it(table: Table) -> None:
    found = PRINTED.search(table.after)
    if found is None:
        assert ONCE.search(table.after), "neither printed by a command nor marked with its date"
        return
    assert problem(found[1]) == ""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_that_a_page_names_exists(page: Path) -> None:
    assert [why for each in PRINTED.findall(page.read_text()) if (why := problem(each))] == []


def test_there_are_sections_with_figures() -> None:
    assert len(SECTIONS) > 20


@pytest.mark.parametrize("section", SECTIONS, ids=str)
def test_figures_in_prose_are_printed_dated_or_stated(section: Section) -> None:
    if PRINTED.search(section.text) or ONCE.search(section.text):
        return
    stated = STATED.search(section.text)
    assert stated, "neither printed by a command, nor dated, nor stated by a module"
    source = ROOT / stated[1]
    assert source.is_file()
    # What a module states has figures of its own.
    assert re.search(r"\d", source.read_text())


def test_figures_in_prose_are_found() -> None:
    assert PROSE_FIGURE.search("it took 15.2 ms") is not None
    assert PROSE_FIGURE.search("three times as long in 8 % of runs") is not None
    assert PROSE_FIGURE.search("step 3 of page 7") is None


@pytest.mark.parametrize(
    ("command", "why"),
    [
        ("make bench", ""),
        ("make bench BENCH=--ablate", ""),
        ("make bench BENCH=--never", "harness_floor.py has no --never"),
        ("make nothing", "no target nothing"),
        ("PYTHONPATH=tests/support python tests/simulation/tables.py shares", ""),
        ("PYTHONPATH=tests/support python tests/simulation/tables.py comparisons", ""),
        ("python tests/simulation/tables.py neither", "tables.py has no table neither"),
        ("python tests/bench/gone.py", "no file tests/bench/gone.py"),
        ("python tests/bench/soak.py --weeks 3", "soak.py has no --weeks"),
        ("rm -r /", "rm is neither make nor python"),
    ],
)
def test_what_does_not_exist_is_found(command: str, why: str) -> None:
    assert problem(command) == why


def test_figures_are_told_from_words() -> None:
    rows = ["| a | b |", "| --- | --- |", "| x | 0.142, 0.295 ms |"]
    assert _has_figures(rows)
    assert _has_figures(["| a | b |", "| --- | --- |", "| x | 64 / 0 |"])
    assert not _has_figures(["| a | exit code |", "| --- | --- |", "| x | 4 |"])
    assert not _has_figures(["| a | b |", "| --- | --- |", "| x | `10 s` |"])
    assert not _has_figures(["| a | b |", "| --- | --- |", "| x | a first word |"])
