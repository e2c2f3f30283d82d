"""What a spec calls a bag: a path, a real dataset, or a synthetic one."""

from __future__ import annotations

from pathlib import Path

import pytest

from data_bags import chatter, refusal_of, write_bag
from r2bspec.bags.recording import BagLocation, DataError
from r2bspec.datasets.catalogue import index, known_datasets, locate


def test_a_slash_makes_a_path_relative_to_the_spec(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bags" / "mine", chatter())
    location = locate("bags/mine", tmp_path)
    assert location == BagLocation(kind="recorded", path=bag)
    assert index(location).message_count == 6
    assert locate(str(bag), Path("/")).path == bag


def test_what_lies_beside_the_spec_is_a_path(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "r2b_storage", chatter())
    assert locate("r2b_storage", tmp_path).path == bag


def test_a_missing_path_is_no_dataset(tmp_path: Path) -> None:
    assert refusal_of(locate, "./r2b_storage", tmp_path).code == "R2B301"


def test_a_name_is_a_synthetic_dataset(tmp_path: Path) -> None:
    location = locate("r2b_storage", tmp_path)
    assert location == BagLocation(kind="synthetic", dataset="r2b_storage")
    assert index(location).synthetic


def test_real_datasets_take_precedence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = write_bag(tmp_path / "real" / "r2b_storage", chatter())
    monkeypatch.setenv("R2B_DATASETS", str(real.parent))
    location = locate("r2b_storage", tmp_path)
    assert location == BagLocation(kind="recorded", path=real, dataset="r2b_storage")
    assert not index(location).synthetic
    assert locate("r2b_lounge", tmp_path).kind == "synthetic"


def test_real_datasets_may_have_names_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_bag(tmp_path / "real" / "r2b_robotarm", chatter())
    monkeypatch.setenv("R2B_DATASETS", str(tmp_path / "real"))
    assert locate("r2b_robotarm", tmp_path).kind == "recorded"
    assert "r2b_robotarm" in known_datasets()
    assert refusal_of(locate, "r2b_robotram", tmp_path).hint == "did you mean r2b_robotarm?"


def test_a_wrong_datasets_folder_is_not_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("R2B_DATASETS", str(tmp_path / "unmounted"))
    with pytest.raises(DataError, match=r"R2B_DATASETS is .*unmounted"):
        locate("r2b_storage", tmp_path)


@pytest.mark.parametrize("name", ["", "r2b_strage", "nothing of the kind"])
def test_unknown_names_are_refused(tmp_path: Path, name: str) -> None:
    assert refusal_of(locate, name, tmp_path).code == "R2B307"
