"""What several test modules of this folder share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from data_bags import WINDOW
from r2bspec.data.model import MadeDataset
from r2bspec.data.synthesis import make


@pytest.fixture(scope="session")
def storage_room(tmp_path_factory: pytest.TempPathFactory) -> MadeDataset:
    """A short stretch of r2b_storage with every topic."""
    return make("r2b_storage", None, WINDOW, cache_dir=tmp_path_factory.mktemp("datasets"))


@pytest.fixture
def real_bags() -> Path:
    """Folder of recordings that others made."""
    folder = os.environ.get("R2BSPEC_TEST_BAGS", "")
    if not folder:
        pytest.skip("R2BSPEC_TEST_BAGS names no folder")
    return Path(folder)


@pytest.fixture(autouse=True)
def no_real_datasets(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tester's own datasets must not change what names mean."""
    monkeypatch.delenv("R2B_DATASETS", raising=False)
