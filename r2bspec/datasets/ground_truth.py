"""The ground truth of a synthetic dataset: what is true, and its files in the bag folder."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import msgspec

from r2bspec.bags.recording import DISPARITY_NAME, GROUND_TRUTH_NAME
from r2bspec.datasets.cameras import Camera, Pose, camera_pose, project, quaternion
from r2bspec.datasets.rig import IMAGE, STEREO_PAIRS, TopicSource
from r2bspec.datasets.scenes import FAMILY, Scene, Tag, tag_pose
from r2bspec.safe_io.safe_json import read_json

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


CONVENTIONS = (
    "Metres, pixels, ns since the epoch, quaternions x y z w. World: z up. Body: x forward, y"
    " left, z up, origin at the IMU. Optical frames: x right, y down, z forward. Tag frame: x"
    " right and y down in the tag's own image as its authors print it, z into the tag. Pixel"
    " (u, v) has its centre at whole numbers. Disparity d, of rectified images with the focal"
    " length and principal point of their cameras: pixel (u, v) of the left image shows the same"
    " point as (u - d, v) of the right one, unless something hides it there. Corners of tags are"
    " those in the image as it was recorded, distortion included."
)

# Disparities are stored as whole parts of a pixel, in 16 bits.
DISPARITY_PARTS = 128


class StampedPose(msgspec.Struct, frozen=True, kw_only=True):
    """A pose at a time, in the parent frame that its field names."""

    stamp_ns: int
    position_m: tuple[float, float, float]
    orientation_xyzw: tuple[float, float, float, float]


class TagSighting(StampedPose, frozen=True, kw_only=True):
    """The tag in a camera's optical frame, and where its corners appear.

    Attributes:
        corners_px: outer corners of the black border, from the top left in the tag's own image
            clockwise.
        visible: whether all of them lie inside the image.
    """

    corners_px: tuple[tuple[float, float], ...]
    visible: bool


class TagTruth(msgspec.Struct, frozen=True, kw_only=True):
    """The tag; `sightings` by image topic, one a frame."""

    family: str
    id: int
    size_m: float
    sightings: dict[str, tuple[TagSighting, ...]]


class CameraTruth(msgspec.Struct, frozen=True, kw_only=True):
    """An image topic's camera; its optical frame sits at `position_in_body_m`, looking ahead.

    `distortion` has OpenCV's k1, k2, p1, p2, k3; it is empty for an ideal lens.
    """

    frame_id: str
    width: int
    height: int
    focal_px: float
    center_px: tuple[float, float]
    position_in_body_m: tuple[float, float, float]
    distortion: tuple[float, ...] = ()


class StereoTruth(msgspec.Struct, frozen=True, kw_only=True):
    """A rectified pair; `stamps_ns` are those with disparities in the file."""

    left_topic: str
    right_topic: str
    focal_px: float
    baseline_m: float
    stamps_ns: tuple[int, ...]


class GroundTruth(msgspec.Struct, frozen=True, kw_only=True):
    """ground_truth.json.

    Attributes:
        conventions: the frames and units, in words.
        cameras: by image topic.
        body: the body in the world, at every stamp of the bag.
        tag: None where the sequence shows none.
        stereo: by pair, where both images were made.
    """

    format: Literal["r2bspec-ground-truth-v1"] = "r2bspec-ground-truth-v1"
    dataset: str
    conventions: str = CONVENTIONS
    cameras: dict[str, CameraTruth]
    body: tuple[StampedPose, ...]
    tag: TagTruth | None
    stereo: dict[str, StereoTruth]


def write_ground_truth(folder: Path, truth: GroundTruth) -> None:
    """Write ground_truth.json, formatted to be read.

    Raises:
        OSError: the folder cannot be written.
    """
    text = msgspec.json.format(msgspec.json.encode(truth), indent=1)
    (folder / GROUND_TRUTH_NAME).write_bytes(text + b"\n")


def write_disparities(
    folder: Path, disparities: Iterable[tuple[str, int, NDArray[np.uint16]]]
) -> None:
    """Write disparity.npz one image at a time; `numpy.load` reads it.

    Args:
        folder: where to.
        disparities: pair, stamp in ns, and disparity in 1/128 px.

    Raises:
        OSError: the folder cannot be written.
    """
    import numpy as np

    with zipfile.ZipFile(
        folder / DISPARITY_NAME, "w", zipfile.ZIP_DEFLATED, compresslevel=1
    ) as archive:
        for pair, stamp_ns, parts in disparities:
            # By name, and not from a file: then the entry carries no date and bytes repeat.
            with archive.open(f"{pair}/{stamp_ns}.npy", "w") as stream:
                np.lib.format.write_array(stream, parts)


def build_ground_truth(
    dataset: str,
    scene: Scene,
    start_ns: int,
    times_ns: dict[TopicSource, list[int]],
) -> GroundTruth:
    """What is true of a stretch of a sequence.

    Args:
        dataset: the sequence's name.
        scene: what it shows.
        start_ns: its start, ns since the epoch.
        times_ns: of each made topic's messages, after that start.
    """
    views = {
        source: source.camera
        for source in times_ns
        if source.camera is not None and source.type == IMAGE
    }
    every_time = sorted({time_ns for times in times_ns.values() for time_ns in times})
    return GroundTruth(
        dataset=dataset,
        cameras={source.name: _camera_truth(camera) for source, camera in views.items()},
        body=tuple(
            _stamped_pose(scene.motion.pose(time_ns / 1e9), start_ns + time_ns)
            for time_ns in every_time
        ),
        tag=None if scene.tag is None else _tag_truth(scene, scene.tag, start_ns, times_ns),
        stereo=_stereo_truth(start_ns, {source.name: source for source in views}, times_ns),
    )


def _tag_truth(
    scene: Scene, tag: Tag, start_ns: int, times_ns: dict[TopicSource, list[int]]
) -> TagTruth:
    return TagTruth(
        family=FAMILY,
        id=tag.id,
        size_m=tag.size_m,
        sightings={
            source.name: tuple(
                _tag_sighting(scene, tag, source.camera, start_ns, time_ns) for time_ns in times
            )
            for source, times in times_ns.items()
            if source.camera is not None and source.type == IMAGE
        },
    )


def _stereo_truth(
    start_ns: int, images: dict[str, TopicSource], times_ns: dict[TopicSource, list[int]]
) -> dict[str, StereoTruth]:
    truths = {}
    for pair in STEREO_PAIRS:
        left, right = images.get(pair.left_topic), images.get(pair.right_topic)
        if left is not None and right is not None and right.camera is not None:
            truths[pair.name] = StereoTruth(
                left_topic=pair.left_topic,
                right_topic=pair.right_topic,
                focal_px=right.camera.focal_px,
                baseline_m=right.camera.baseline_m,
                stamps_ns=tuple(start_ns + time_ns for time_ns in times_ns[left]),
            )
    return truths


def _camera_truth(camera: Camera) -> CameraTruth:
    return CameraTruth(
        frame_id=camera.frame_id,
        width=camera.width,
        height=camera.height,
        focal_px=camera.focal_px,
        center_px=camera.center_px,
        position_in_body_m=camera.position_m,
        distortion=() if camera.lens is None else camera.lens.coefficients,
    )


def _stamped_pose(pose: Pose, stamp_ns: int) -> StampedPose:
    return StampedPose(
        stamp_ns=stamp_ns,
        position_m=pose.position_m,
        orientation_xyzw=quaternion(pose.rotation),
    )


def _tag_sighting(
    scene: Scene, tag: Tag, camera: Camera, start_ns: int, time_ns: int
) -> TagSighting:
    pose = tag_pose(tag, camera_pose(scene.motion.pose(time_ns / 1e9), camera))
    half = tag.size_m / 2
    places = ((-half, -half), (half, -half), (half, half), (-half, half))
    corners = [pose.apply((x, y, 0.0)) for x, y in places]
    pixels = tuple(project(camera, corner) for corner in corners)
    return TagSighting(
        stamp_ns=start_ns + time_ns,
        position_m=pose.position_m,
        orientation_xyzw=quaternion(pose.rotation),
        corners_px=pixels,
        visible=all(z > 0 for _, _, z in corners)
        and all(0 <= u < camera.width and 0 <= v < camera.height for u, v in pixels),
    )


def read_ground_truth(folder: Path) -> GroundTruth | None:
    """The ground truth of a recording; None if its folder has none that can be read."""
    try:
        return read_json(folder / GROUND_TRUTH_NAME, GroundTruth)
    except (OSError, msgspec.MsgspecError):
        return None


def read_disparity(folder: Path, pair: str, stamp_ns: int) -> NDArray[np.float32]:
    """The true disparities of a stereo pair at a stamp.

    Returns:
        Pixels of the rectified left image, shape (height, width).

    Raises:
        KeyError: there are none of that pair and stamp.
        ValueError, zipfile.BadZipFile: the file is damaged.
        OSError: it cannot be read.
    """
    import numpy as np

    with np.load(folder / DISPARITY_NAME, allow_pickle=False) as arrays:
        parts = arrays[f"{pair}/{stamp_ns}"]
    disparity: NDArray[np.float32] = parts.astype(np.float32) / np.float32(DISPARITY_PARTS)
    return disparity
