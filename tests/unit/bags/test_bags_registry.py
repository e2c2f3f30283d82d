"""The storage formats of bags are listed once: another one is an entry and its module."""

from __future__ import annotations

import ast
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from types import ModuleType

import pytest

from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.errors import DataError
from r2bspec.bags.largest_message import measure_largest
from r2bspec.bags.recording import Message
from r2bspec.bags.storage.storage import StoredTopic, import_from_storage
from r2bspec.language import bag_formats
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


@pytest.mark.parametrize("module", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_other_module_lists_formats(module: Path) -> None:
    assert list(named_formats(module.read_text())) == []


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
    if entry.sizes:
        assert callable(import_from_storage(entry.sizes))


def test_names_and_suffixes_are_different() -> None:
    assert len({each.name for each in BAG_FORMATS}) == len(BAG_FORMATS)
    assert len({each.suffix for each in BAG_FORMATS}) == len(BAG_FORMATS)


class LineStorage:
    """A format of this test: each line of a file is the time of a message of one topic."""

    def __init__(self, path: Path, display_path: Path) -> None:
        del display_path
        self._times = [int(line) for line in path.read_text().split()]
        self.message_count = len(self._times)
        self.topics = (StoredTopic("/ticks", "std_msgs/msg/Empty", "cdr", self.message_count),)
        self.start_ns, self.end_ns = min(self._times), max(self._times)

    def messages(
        self, names: Collection[str], start_ns: int | None, stop_ns: int | None
    ) -> Iterator[Message]:
        assert "/ticks" in names
        assert (start_ns, stop_ns) == (None, None)
        for time_ns in self._times:
            yield Message(topic="/ticks", time_ns=time_ns, data=b"\x00\x01\x00\x00\x00")

    def close(self) -> None:
        pass


def test_an_entry_and_a_module_are_all_that_a_format_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = tmp_path / "run.lines"
    bag.write_text("10\n20\n30\n")
    with pytest.raises(DataError, match="neither a bag folder nor a"):
        index_bag(bag)
    module = ModuleType("r2bspec.bags.storage.lines")
    monkeypatch.setattr(module, "LineStorage", LineStorage, raising=False)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    entry = BagFormat(
        name="lines", title="lines", suffix=".lines", reader="lines:LineStorage", note="lines"
    )
    monkeypatch.setattr(bag_formats, "BAG_FORMATS", (*BAG_FORMATS, entry))
    index = index_bag(bag)
    assert (index.storage, index.message_count, index.notes) == ("lines", 3, ("lines",))
    assert [each.time_ns for each in read_messages(bag, ["/ticks"])] == [10, 20, 30]
    assert measure_largest(bag, ["/ticks"]) == 5
