"""Files that a fuzzer found interesting, or that once broke something: all are answered."""

from __future__ import annotations

from pathlib import Path

import pytest
from fuzz_target import check_bytes

CORPUS = sorted((Path(__file__).parent / "corpus").iterdir())


@pytest.mark.timeout(30)
@pytest.mark.parametrize("file", CORPUS, ids=lambda file: file.name)
def test_replay(file: Path) -> None:
    check_bytes(file.read_bytes())
