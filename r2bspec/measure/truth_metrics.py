"""The kinds of truth that messages can be compared with, and the metrics of each."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

import msgspec

from r2bspec.language.spec import TruthKind


class TruthTraits(msgspec.Struct, frozen=True):
    """What a kind of truth says, and of what.

    Attributes:
        format: the type of the messages that can be compared.
        metrics: their names.
        named: what ``truth.name`` names in the ground truth.
    """

    format: str
    metrics: tuple[str, ...]
    named: str


BAD_PIXELS: Final = "accuracy.disparity_bad_pixels"
DENSITY: Final = "accuracy.disparity_density"
TAG_MISSED: Final = "accuracy.tag_missed"
TAG_FALSE: Final = "accuracy.tag_false"
TAG_POSITION_ERROR: Final = "accuracy.tag_position_error"

TRUTHS: Final[MappingProxyType[TruthKind, TruthTraits]] = MappingProxyType(
    {
        "disparity": TruthTraits(
            format="stereo_msgs/msg/DisparityImage",
            metrics=(BAD_PIXELS, DENSITY),
            named="a stereo pair",
        ),
        "tag": TruthTraits(
            format="geometry_msgs/msg/PoseArray",
            metrics=(TAG_MISSED, TAG_FALSE, TAG_POSITION_ERROR),
            named="an image topic",
        ),
    }
)


def kind_of(metric: str) -> TruthKind | None:
    """The kind of truth that a metric needs; None if it needs none."""
    return next((kind for kind, traits in TRUTHS.items() if metric in traits.metrics), None)
