"""Files of folded stacks: what is written is read, and nothing else is believed."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from r2bspec.record import run_folder
from r2bspec.record.run_folder import OTHER_STACKS, read_stacks, write_stacks
from r2bspec.safe_io.safe_file import RefusedFileError

NAMES = st.text(
    st.characters(blacklist_categories=["Cs", "Cc", "Z"], blacklist_characters=";")
).filter(bool)


@settings(max_examples=20)  # each is synchronised to the disk
@given(stacks=st.dictionaries(st.lists(NAMES, min_size=1).map(tuple), st.integers(1, 10**9)))
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, stacks: dict[tuple[str, ...], int]
) -> None:
    folder = tmp_path_factory.mktemp("stacks")
    write_stacks(folder / "a.folded", stacks)
    assert read_stacks(folder / "a.folded", folder) == stacks


def test_names_keep_no_separators(tmp_path: Path) -> None:
    write_stacks(tmp_path / "a.folded", {("a;b", "c\nd e", ""): 3})
    assert read_stacks(tmp_path / "a.folded", tmp_path) == {("a:b", "c d e", "[unknown]"): 3}


def test_lines_that_are_no_stacks_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.folded"
    path.write_bytes(b"main;work 2\n\nmain\nmain -1\nmain 1e9\nmain;work 3\n\xff 1\n" + b"a 9" * 20)
    found = read_stacks(path, tmp_path)
    assert found == {("main", "work"): 5, ("\N{REPLACEMENT CHARACTER}",): 1, ("a 9" * 19 + "a",): 9}


def test_no_file_outside_the_folder_is_read(tmp_path: Path) -> None:
    inside = tmp_path / "run"
    inside.mkdir()
    (tmp_path / "secret.folded").write_text("main 1\n")
    (inside / "link.folded").symlink_to(tmp_path / "secret.folded")
    for each in (inside / "link.folded", inside / "../secret.folded"):
        with pytest.raises(RefusedFileError):
            read_stacks(each, inside)


def test_of_very_many_stacks_those_with_the_most_samples_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.folded"
    path.write_text("a;x 1\na;b 7\na;c 2\na;y 1\na;c 6\n")
    monkeypatch.setattr(run_folder, "MAX_STACK_FRAMES", 4)
    assert read_stacks(path, tmp_path) == {("a", "b"): 7, ("a", "c"): 8, OTHER_STACKS: 2}
