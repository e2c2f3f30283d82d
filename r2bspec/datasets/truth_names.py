"""What a recording's ground truth is about, without reading or rendering images."""

from __future__ import annotations

from collections.abc import Collection

import msgspec

from r2bspec.bags.recording import BagLocation
from r2bspec.datasets.scene.rig import IMAGE, STEREO_PAIRS
from r2bspec.datasets.sequences import SEQUENCES


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
    from r2bspec.datasets.read_truth import read_ground_truth

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
