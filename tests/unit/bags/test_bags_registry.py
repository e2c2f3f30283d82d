"""The storage formats of bags are listed once: another one is an entry and its module."""

from __future__ import annotations

import pytest

from r2bspec.bags.recording import BAG_FORMATS, BagFormat
from r2bspec.bags.storage.storage import import_from_storage
from r2bspec.language.declaration import rule_at


@pytest.mark.parametrize("entry", BAG_FORMATS, ids=lambda entry: entry.name)
def test_every_entry_leads_to_its_code(entry: BagFormat) -> None:
    assert callable(import_from_storage(entry.reader))
    described = rule_at(("data_loader", "bag", "path"))
    assert described is not None
    assert entry.suffix in described.description
