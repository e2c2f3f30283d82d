"""What several tests of bags start from."""

from __future__ import annotations

from pathlib import Path

import pytest

from data_bags import chatter, write_bag


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Six messages of two topics."""
    return write_bag(tmp_path / "bag", chatter())
