"""Inputs that a fuzzer found interesting, or that once broke something: all are answered."""

from __future__ import annotations

from pathlib import Path

import pytest
from readers import CORPUS, READERS, read

FILES = [(name, file) for name in READERS for file in sorted((CORPUS / name).glob("*"))]


@pytest.mark.timeout(60)
@pytest.mark.parametrize(("name", "file"), FILES, ids=[f"{n} {f.name}" for n, f in FILES])
def test_replay(name: str, file: Path) -> None:
    read(name, file.read_bytes())


@pytest.mark.parametrize("name", READERS)
def test_seeds(name: str) -> None:
    """What targets begin with is of use."""
    for seed in READERS[name].seeds():
        read(name, seed)
