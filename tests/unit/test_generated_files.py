"""The files that the program writes are those of the sources: `make generated` changes nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from generated_files import ROOT, generated_files, stale_files

FILES = generated_files()


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_a_generated_file_is_up_to_date(file: Path) -> None:

    assert file.read_text(encoding="utf-8") == FILES[file], "run 'make generated'"


def test_no_generated_file_is_left_over() -> None:
    assert stale_files() == set()


def test_the_pages_have_what_is_written_into_them() -> None:
    assert "<!-- keys of spec -->\n- " in FILES[ROOT / "docs" / "language.md"]
    assert "<!-- exit statuses -->\n| " in FILES[ROOT / "docs" / "running.md"]
