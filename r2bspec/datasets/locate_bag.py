"""From what a spec calls a bag to where it is, and to what its ground truth is about."""

from __future__ import annotations

import os
from collections.abc import Collection
from functools import cache
from pathlib import Path

import msgspec

from r2bspec.bags.errors import BAG_NOT_FOUND, DataError
from r2bspec.bags.recording import BagIndex, BagLocation
from r2bspec.datasets.scene.rig import IMAGE, STEREO_PAIRS
from r2bspec.datasets.sequences import SEQUENCES, describe, unknown_dataset_error
from r2bspec.diagnostics.quote import clip
from r2bspec.untrusted.safe_file import is_folder, is_there, names_in

_MAX_NAME_LENGTH = 4095  # that of Linux
DATASETS_VARIABLE = "R2B_DATASETS"


def locate(bag: str, base_dir: Path) -> BagLocation:
    """Decide whether a bag is a path, a real dataset or a synthetic one.

    What has a ``/``, or exists relative to `base_dir`, is a path. Anything else names a dataset:
    the folder of that name under ``$R2B_DATASETS`` if there is one, else the catalogue's.

    Args:
        bag: as written in the spec.
        base_dir: folder of the spec.

    Raises:
        DataError: the path does not exist (R2B301), the name is unknown (R2B307), or
            ``$R2B_DATASETS`` is no folder (R2B301).
    """
    if len(bag) > _MAX_NAME_LENGTH:
        raise DataError(
            f"the name of a bag has {len(bag):,} characters: {clip(bag)}",
            code=BAG_NOT_FOUND,
            hint=f"a path has at most {_MAX_NAME_LENGTH:,}",
        )
    path = base_dir / _expanded(bag)
    if bag and is_there(path):
        return BagLocation(kind="recorded", path=path)
    if "/" in bag:
        raise DataError(
            f"{path} does not exist",
            code=BAG_NOT_FOUND,
            hint=f"paths are relative to {base_dir}; a dataset name has no '/'",
        )
    return locate_dataset(bag)


def locate_dataset(name: str) -> BagLocation:
    """Find a dataset by its name: the recorded one if there is one, else the synthetic one.

    Raises:
        DataError: R2B307; R2B301 where ``$R2B_DATASETS`` is no folder.
    """
    real = _datasets_folder()
    if real is not None and name and is_there(real / name):
        return BagLocation(kind="recorded", path=real / name, dataset=name)
    if name not in SEQUENCES:
        raise unknown_dataset_error(name, known_datasets())
    return BagLocation(kind="synthetic", dataset=name)


def index(location: BagLocation) -> BagIndex:
    """Index a located bag; a synthetic one is not rendered.

    Raises:
        DataError: as `index_bag`.
    """
    if location.path is not None:
        from r2bspec.bags.bag_index import index_bag

        return index_bag(location.path)
    return _index_synthetic(location.dataset or "")


@cache
def _index_synthetic(name: str) -> BagIndex:
    return describe(name)


def known_datasets() -> tuple[str, ...]:
    """The names of all synthetic and recorded datasets, sorted.

    Raises:
        DataError: ``$R2B_DATASETS`` is no folder (R2B301).
    """
    real = _datasets_folder()
    recorded = [each for each in names_in(real) if is_folder(real / each)] if real else []
    return tuple(sorted({*SEQUENCES, *recorded}))


def _expanded(path: str) -> str:
    """A path with the home folder in place of ``~``."""
    return os.path.expanduser(path)  # noqa: PTH111 - that of pathlib raises for unknown users


def _datasets_folder() -> Path | None:
    """The folder of recorded datasets; None if the variable is not set."""
    value = os.environ.get(DATASETS_VARIABLE) or ""
    if not value:
        return None
    folder = Path(_expanded(value))
    if not is_folder(folder):
        # The synthetic data would be another measurement than the one requested.
        raise DataError(
            f"${DATASETS_VARIABLE} is {folder}, which is not a folder",
            code=BAG_NOT_FOUND,
            hint="set it to the folder of the r2b bags, or unset it",
        )
    return folder


class TruthNames(msgspec.Struct, frozen=True):
    """The names that `truth.name` can have.

    Attributes:
        disparity: stereo pairs.
        tag: image topics that show the tag.
    """

    disparity: tuple[str, ...] = ()
    tag: tuple[str, ...] = ()


def truth_names(location: BagLocation, topics: Collection[str]) -> TruthNames | None:
    """The names in the ground truth of a recording.

    Args:
        location: of the recording.
        topics: those that are loaded: of a synthetic dataset, only they are made.

    Returns:
        None if it has no ground truth.
    """
    if location.path is None:
        return _synthetic(location.dataset or "", {f"/{each.strip('/')}" for each in topics})
    from r2bspec.datasets.ground_truth import read_ground_truth

    known = read_ground_truth(location.path)
    if known is None:
        return None
    tag = tuple(known.tag.sightings) if known.tag is not None else ()
    return TruthNames(disparity=tuple(known.stereo), tag=tag)


def _synthetic(dataset: str, topics: Collection[str]) -> TruthNames:
    from r2bspec.datasets.scene.scenes import find_scene

    images = {each.name for each in SEQUENCES[dataset].sources if each.type == IMAGE}
    made = images.intersection(topics)
    shows_tag = find_scene(dataset).tag is not None
    return TruthNames(
        disparity=tuple(
            each.name for each in STEREO_PAIRS if {each.left_topic, each.right_topic} <= made
        ),
        tag=tuple(sorted(made)) if shows_tag else (),
    )
