"""The storage formats of bags are listed once: another one is an entry and its module."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from r2bspec.bags.storage.storage import import_from_storage
from r2bspec.language.bag_formats import BAG_FORMATS, BagFormat

PACKAGE = Path(__file__).parents[3] / "r2bspec"
MODULES = sorted(
    each
    for each in PACKAGE.rglob("*.py")
    if each.name != "bag_formats.py" and not each.is_relative_to(PACKAGE / "bags" / "storage")
)


def named_formats(source: str) -> Iterator[str]:
    """Texts of a module that name a suffix, or the name of a format that is only read."""
    nodes = list(ast.walk(ast.parse(source)))
    # A part of a text that is put together, such as the name of a module, is no suffix.
    parts = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
            alone = text in {".mcap", ".bag", "ros1"} and id(node) not in parts
            if alone or ".db3" in text or ".bag " in text:
                yield text


def test_no_other_module_lists_formats() -> None:
    texts = {
        str(module.relative_to(PACKAGE)): list(named_formats(module.read_text()))
        for module in MODULES
    }
    assert {name: found for name, found in texts.items() if found} == {}


@pytest.mark.parametrize(
    "source",
    [
        'SUFFIXES = {".mcap": "mcap"}',
        'hint = f"a {name}.db3 file"',
        'hint = "an .mcap or .bag file"',
        'if storage == "ros1": pass',
    ],
)
def test_a_list_would_be_found(source: str) -> None:
    assert list(named_formats(source))


@pytest.mark.parametrize("entry", BAG_FORMATS, ids=lambda entry: entry.name)
def test_every_entry_leads_to_its_code(entry: BagFormat) -> None:
    assert callable(import_from_storage(entry.reader))


def test_names_and_suffixes_are_different() -> None:
    assert len({each.name for each in BAG_FORMATS}) == len(BAG_FORMATS)
    assert len({each.suffix for each in BAG_FORMATS}) == len(BAG_FORMATS)
