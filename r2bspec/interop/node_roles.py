"""Which nodes of a script belong to the harness, to the preprocessors, and to the graph.

ros2_benchmark runs all of them at once, so its scripts do not tell. The decision rests, in this
order, on: a topic of the loader, a buffer of the player, or a topic that is played or monitored;
the lists in the docstring and names that begin with ``Prep``; topics shared with nodes that are
decided. Default topics of packages that scripts often use are known here, and so are their formats.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from r2bspec.interop.recording import Member, NodeAction, RecordedFile

HARNESS_PACKAGES: Final = frozenset({"ros2_benchmark", "isaac_ros_benchmark"})
_HARNESS: Final = {"DataLoaderNode": "loader", "PlaybackNode": "player", "MonitorNode": "monitor"}
_HEADING: Final = re.compile(
    r"preprocessors?|graph under test|required|packages|datasets", re.IGNORECASE
)
_ADAPTED: Final = {
    "nitros_camera_info": "sensor_msgs/msg/CameraInfo",
    "nitros_compressed_image": "sensor_msgs/msg/CompressedImage",
    "nitros_detection2_d_array": "vision_msgs/msg/Detection2DArray",
    "nitros_detection3_d_array": "vision_msgs/msg/Detection3DArray",
    "nitros_april_tag_detection_array": "isaac_ros_apriltag_interfaces/msg/AprilTagDetectionArray",
    "nitros_flat_scan": "isaac_ros_pointcloud_interfaces/msg/FlatScan",
    "nitros_point_cloud": "sensor_msgs/msg/PointCloud2",
    "nitros_pose_cov_stamped": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nitros_image_bridge": "isaac_ros_nitros_bridge_interfaces/msg/NitrosBridgeImage",
    "nitros_imu": "sensor_msgs/msg/Imu",
    "nitros_odometry": "nav_msgs/msg/Odometry",
    "nitros_occupancy_grid": "nav_msgs/msg/OccupancyGrid",
}
_ADAPTED_PREFIXES: Final = {
    "nitros_image_": "sensor_msgs/msg/Image",
    "nitros_disparity_image": "stereo_msgs/msg/DisparityImage",
    "nitros_tensor_list": "isaac_ros_tensor_list_interfaces/msg/TensorList",
}

_TOPICS: Final = {
    "ImageToTensorNode": ("image", "tensor"),
    "ImageTensorNormalizeNode": ("tensor", "normalized_tensor"),
    "InterleavedToPlanarNode": ("interleaved_tensor", "planar_tensor"),
    "ReshapeNode": ("tensor", "reshaped_tensor"),
    "ResizeNode": ("image", "camera_info", "resize/image", "resize/camera_info"),
    "RectifyNode": ("image_raw", "camera_info", "image_rect", "camera_info_rect"),
    "PadNode": ("image", "padded_image"),
    "CropNode": ("image", "camera_info", "crop/image", "crop/camera_info"),
    "ImageFormatConverterNode": ("image_raw", "image"),
    "TensorRTNode": ("tensor_pub", "tensor_sub"),
    "TritonNode": ("tensor_pub", "tensor_sub"),
    "UNetDecoderNode": ("tensor_sub", "unet/raw_segmentation_mask"),
    "DopeDecoderNode": ("belief_map_array", "camera_info", "dope/detections"),
    "DetectNetDecoderNode": ("tensor_sub", "detectnet/detections"),
    "CenterPoseDecoderNode": ("tensor_sub", "camera_info", "centerpose/detections"),
    "ESSDisparityNode": ("left/image_rect", "right/image_rect", "disparity"),
    "DisparityNode": ("left/image_rect", "right/image_rect", "disparity"),
    "DisparityToDepthNode": ("disparity", "depth"),
    "PointCloudNode": ("left/image_rect_color", "disparity", "points2"),
    "RtDetrPreprocessorNode": ("encoded_tensor", "tensor_pub"),
    "RtDetrDecoderNode": ("tensor_sub", "detections_output"),
}
"""Default topics by the class of the plugin, in ``nvidia::isaac_ros``.

They only tell which nodes of a script are connected; they are no interfaces.
"""


@dataclass(slots=True)
class ScriptGraph:
    """The actions of a script by their roles.

    Attributes:
        undecided: members of the graph of which nothing tells that they are no preprocessors.
        further: second loaders and players.
    """

    loader: NodeAction | None = None
    player: NodeAction | None = None
    monitors: list[NodeAction] = field(default_factory=list)
    preprocessors: list[Member] = field(default_factory=list)
    graph: list[Member] = field(default_factory=list)
    undecided: list[Member] = field(default_factory=list)
    further: list[NodeAction] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class PlayedInput:
    """An input of the player: its number, the topic that is played, and its buffered topic.

    Both topics are as the player names them: relative to its namespace.
    """

    number: int
    topic: str
    source: str
    player: NodeAction


def divide_by_role(recorded: RecordedFile, namespace: str) -> ScriptGraph:
    """Return the actions by their roles.

    Args:
        recorded: all actions of the script.
        namespace: the namespace of the benchmark, absolute.
    """
    graph = ScriptGraph()
    others: list[Member] = []
    for node in recorded.nodes:
        kind = _harness_part(node)
        if kind == "monitor":
            graph.monitors.append(node)
        elif kind == "loader" and graph.loader is None:
            graph.loader = node
        elif kind == "player" and graph.player is None:
            graph.player = node
        elif kind:
            graph.further.append(node)
        else:
            others.append(node)
    others += recorded.includes
    if graph.player is None:
        graph.graph = others
        return graph
    roles = _Roles(graph, others, recorded.docstring, namespace).decide()
    for member, role in zip(others, roles, strict=True):
        (graph.preprocessors if role == "preprocessor" else graph.graph).append(member)
        if not role:
            graph.undecided.append(member)
    return graph


def played_inputs(player: NodeAction | None) -> list[PlayedInput]:
    """Return the inputs for which the player has remappings, by number; none without a player."""
    if player is None:
        return []
    matches = (
        re.fullmatch(r"/?(?:buffer/)?input(\d{1,3})", source) for source, _ in player.remappings
    )
    return [
        PlayedInput(
            number,
            player.remapped(f"input{number}"),
            player.remapped(f"buffer/input{number}"),
            player,
        )
        for number in sorted({int(match[1]) for match in matches if match})
    ]


def ros_format(name: str) -> str:
    """Return the ROS type to which a negotiated format is converted; empty if unknown."""
    if name in _ADAPTED:
        return _ADAPTED[name]
    return next((kind for start, kind in _ADAPTED_PREFIXES.items() if name.startswith(start)), "")


def _harness_part(node: NodeAction) -> str:
    if node.package not in HARNESS_PACKAGES:
        return ""
    return next((part for end, part in _HARNESS.items() if node.plugin_class.endswith(end)), "")


class _Roles:
    def __init__(
        self, graph: ScriptGraph, others: list[Member], docstring: str, namespace: str
    ) -> None:
        self.others = others
        self.namespace = namespace
        inputs = played_inputs(graph.player)
        played = {self._topic(input_.topic, input_.player) for input_ in inputs}
        buffers = {self._topic(input_.source, input_.player) for input_ in inputs}
        loaders = [graph.loader] if graph.loader is not None else []
        self.before = (self._targets(loaders) | buffers) - played
        self.after = played | self._targets(graph.monitors)
        self.topics = [self._topics(member) for member in others]
        self.sections = _sections(docstring)

    def decide(self) -> list[str]:
        """Return the role of each of the others; empty where nothing tells it."""
        roles = [
            self._by_topics(topics) or self._by_text(member)
            for member, topics in zip(self.others, self.topics, strict=True)
        ]
        near: dict[str, set[str]] = {topic: set() for topics in self.topics for topic in topics}
        for role, topics in zip(roles, self.topics, strict=True):
            for topic in topics if role else ():
                near[topic].add(role)
        changed = True
        while changed:
            changed = False
            for index, topics in enumerate(self.topics):
                shared = set().union(*(near[topic] for topic in topics))
                if not roles[index] and len(shared) == 1:
                    # It has the role of all that it shares a topic with.
                    roles[index] = next(iter(shared))
                    for topic in topics:
                        near[topic] |= shared
                    changed = True
        return roles

    def _topic(self, topic: str, member: Member) -> str:
        return topic_in(member.namespace or self.namespace, topic)

    def _targets(self, nodes: list[NodeAction]) -> set[str]:
        return {self._topic(target, node) for node in nodes for _, target in node.remappings}

    def _topics(self, member: Member) -> set[str]:
        names = [target for _, target in member.remappings]
        if isinstance(member, NodeAction):
            own = {source.lstrip("/") for source, _ in member.remappings}
            is_listed = member.plugin.startswith("nvidia::isaac_ros::")
            defaults = _TOPICS.get(member.plugin_class, ()) if is_listed else ()
            names += [name for name in defaults if name not in own]
        else:
            values = member.arguments.values()
            names += [value for value in values if isinstance(value, str) and value]
        return {self._topic(name, member) for name in names}

    def _by_topics(self, topics: set[str]) -> str:
        before, after = bool(topics & self.before), bool(topics & self.after)
        if before == after:
            return ""
        return "preprocessor" if before else "graph"

    def _by_text(self, member: Member) -> str:
        if member.name.lower().startswith("prep"):
            return "preprocessor"
        last = member.plugin_class if isinstance(member, NodeAction) else ""
        for name in filter(None, (member.name, last)):
            places = [role for role, text in self.sections.items() if name in text]
            if len(places) == 1:
                return places[0]
        return ""


def _sections(docstring: str) -> dict[str, str]:
    """Return the parts of a docstring that list preprocessors and the nodes under test."""
    sections = {"preprocessor": "", "graph": ""}
    current = ""
    for line in docstring.splitlines():
        heading = _HEADING.search(line) if line.rstrip().endswith(":") else None
        if heading:
            word = heading[0].lower()
            current = (
                "preprocessor" if word.startswith("prep") else "graph" if "graph" in word else ""
            )
        elif current:
            sections[current] += line + "\n"
    return sections


def topic_in(namespace: str, topic: str) -> str:
    """Return the absolute name of a topic."""
    return topic if topic.startswith("/") else f"{namespace.rstrip('/')}/{topic}"
