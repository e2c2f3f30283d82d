"""Names of packages and modules are those of docs/glossary.md."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "r2bspec"
PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    """The cells of the table below a heading of the page, without its head."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[2:]]


def quoted(cells: Iterable[str]) -> list[str]:
    return [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]


def listed(heading: str) -> list[str]:
    """The words of the first column, of which a cell may hold several."""
    return [word.strip() for first, *_ in rows(heading) for word in first.split(",")]


PLACES: dict[str, list[str]] = {}
"""Where each name occurs, as a module or as a package."""
for _file in sorted(SOURCE.rglob("*.py")):
    _place = _file.parent if _file.stem == "__init__" else _file
    if _place != SOURCE and _file.stem != "__main__":
        PLACES.setdefault(_place.stem, []).append(str(_place.relative_to(ROOT)))

PACKAGES = {
    ".".join(init.parent.relative_to(SOURCE).parts)
    for init in SOURCE.rglob("__init__.py")
    if init.parent != SOURCE
}
SHARED = quoted(first for first, *_ in rows("Module names that several packages share"))
BANNED = listed("Words that module names do not use")
ALLOWED_ING = listed("Words in -ing that may end a module name")
EXCEPTIONS = quoted(first for first, *_ in rows("Exceptions"))


def banned_words(name: str) -> list[str]:
    """The banned words and sequences of words that a name consists of."""
    spaced = f" {name.replace('_', ' ')} "
    return [word for word in BANNED if f" {word} " in spaced]


def ends_in_participle(name: str) -> bool:
    last = name.rsplit("_", 1)[-1]
    return last.endswith("ing") and last not in ALLOWED_ING


def test_the_page_has_its_tables() -> None:
    assert len(rows("Terms of this project")) > 12
    assert all(len(row) == 4 and all(row) for row in rows("Terms of this project"))
    assert "stretch" in BANNED
    assert "errors" in SHARED


def test_every_term_names_a_module() -> None:
    named = quoted(row[3] for row in rows("Terms of this project"))
    assert len(named) == len(rows("Terms of this project"))
    assert [file for file in named if not (ROOT / file).is_file()] == []


def test_every_package_is_on_the_page_once() -> None:
    on_page = quoted(first for first, *_ in rows("Packages"))
    assert sorted(on_page) == sorted(PACKAGES)
    assert all(contents for _, contents in rows("Packages"))


def test_a_name_is_shared_only_where_the_page_gives_it_one_meaning() -> None:
    shared = {name: places for name, places in PLACES.items() if len(places) > 1}
    assert {name: shared[name] for name in sorted(shared) if name not in SHARED} == {}
    assert [name for name in SHARED if name not in shared] == []


def test_names_have_no_word_that_the_page_replaces() -> None:
    found = {name: banned_words(name) for name in PLACES if name not in EXCEPTIONS}
    assert {name: words for name, words in found.items() if words} == {}


def test_names_do_not_end_in_a_participle() -> None:
    assert [name for name in PLACES if ends_in_participle(name)] == []


def test_no_exception_is_out_of_date() -> None:
    assert [name for name in EXCEPTIONS if not banned_words(name) or name not in PLACES] == []


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("best_light", ["best light"]),
        ("floor", ["floor"]),
        ("placed_beside", ["beside"]),
        ("best_case", []),
        ("batches", []),
    ],
)
def test_banned_words_are_found_as_whole_words(name: str, words: list[str]) -> None:
    assert banned_words(name) == words


@pytest.mark.parametrize(("name", "found"), [("playing", True), ("wiring", False)])
def test_participles_are_found(name: str, found: bool) -> None:
    assert ends_in_participle(name) is found
