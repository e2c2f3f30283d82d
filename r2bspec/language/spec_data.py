"""`data_loader` and `playback`: which recorded messages are played, and how.

What a description says is shown to the authors of specs; see `r2bspec.language.declaration`.
"""

from typing import Annotated, Any, ClassVar, Final, Literal

import msgspec

from r2bspec.language import names
from r2bspec.language.bag_formats import SUFFIXES_TEXT
from r2bspec.language.declaration import Record, key
from r2bspec.language.quantities import Duration, Share

MAX_ENTRIES: Final = 5000
"""Nodes, inputs, monitors or loaded topics of a spec: far above every real one."""

_IMAGE_INPUT: Final = {"from": "buffer/image", "format": "sensor_msgs/msg/Image"}


def _profile(
    depth: int, *, reliability: str = "reliable", durability: str = "volatile"
) -> dict[str, Any]:
    return {
        "reliability": reliability,
        "durability": durability,
        "history": "keep_last",
        "depth": depth,
    }


PROFILES: Final[dict[str, dict[str, Any]]] = {
    "default": _profile(10),
    "sensor_data": _profile(5, reliability="best_effort"),
    "services": _profile(10),
    "parameters": _profile(1000),
    "system_default": _profile(1),
    "clock": _profile(1, reliability="best_effort"),
    "rosout": _profile(1000, durability="transient_local"),
}
"""The quality-of-service profiles of ROS, by their names in rclpy and rmw.

All fields are given explicitly, so that results do not depend on the defaults of a middleware.
`system_default`, which leaves every choice to the middleware, has the values that its publishers
use.
"""

_ProfileName = Annotated[str, key(words=tuple(PROFILES))]


class QoS(Record, frozen=True, kw_only=True):
    """A quality-of-service profile; the default is the one that rclpy uses for `depth=10`.

    Attributes:
        profile: The profile that provides the values of keys that this map does not set.
        reliability: Whether lost messages are sent again. A reliable subscription does not match a
            best-effort publisher.
        durability: Whether a subscription that is made later gets the last messages, too.
        history: Whether only the last 'depth' messages are kept, or all.
        depth: The number of messages that keep_last keeps.
    """

    about = key(
        *("sensor_data", {"reliability": "best_effort", "depth": 5}),
        snippets=(
            {"label": "sensor data", "body": "sensor_data"},
            {
                "label": "field by field",
                "body": {"reliability": "best_effort", "depth": "${1:5}"},
            },
        ),
    )
    word = _ProfileName

    profile: ClassVar[Annotated[_ProfileName, key("default", default="default")]]
    reliability: Literal["reliable", "best_effort"] = "reliable"
    durability: Literal["volatile", "transient_local"] = "volatile"
    history: Literal["keep_last", "keep_all"] = "keep_last"
    depth: Annotated[int, key(10, minimum=1)] = 10

    @classmethod
    def from_word(cls, word: str) -> "QoS":
        """The profile of that name."""
        return cls(**PROFILES[word])

    @classmethod
    def from_keys(cls, keys: dict[str, Any]) -> "QoS":
        """A profile with all fields of the one that it is based on, and its own."""
        return cls(**PROFILES[keys.pop("profile", "default")] | keys)


class BagSource(Record, frozen=True, kw_only=True):
    """A recording: the name of a dataset, or the path of a bag relative to this file. A map can
    also pin the content.

    Attributes:
        dataset: The name of a dataset; 'r2bspec data list' lists them.
        sha256: The digest of the data, as 'r2bspec data info' shows it. A bag with other content is
            refused.
    """

    about = key(
        *("r2b_storage", {"path": "./bags/kitchen"}),
        snippets=(
            {"label": "dataset", "body": "${1:r2b_storage}"},
            {"label": "bag with pinned content", "body": {"path": "$1", "sha256": "$2"}},
        ),
    )
    word = Annotated[str, key(path=True, not_empty=True)]

    dataset: Annotated[str, names.DATASET, key("r2b_storage", "r2b_lounge")] = ""
    path: Annotated[
        names.FilePath,
        key(
            *("./bags/kitchen", "/data/drive_07.mcap"),
            description=f"The path of a bag: its folder, or a single {SUFFIXES_TEXT} file; "
            "relative to this file.",
            path=True,
        ),
    ] = ""
    sha256: Annotated[str, names.SHA256, key("a3f5" * 16)] = ""

    @classmethod
    def from_word(cls, word: str) -> "BagSource":
        """A path if the text looks like one, else a dataset."""
        is_path = "/" in word or word.startswith(".")
        return cls(path=word) if is_path else cls(dataset=word)


class Window(Record, frozen=True, kw_only=True):
    """The part of the recording to use, relative to its first message.

    Attributes:
        start: The start of the window.
        end: The end of the window; default: the end of the recording.
    """

    about = key({"start": "0.0 s", "end": "0.5 s"})

    start: Annotated[Duration, key("0.0 s", "1.5 s")] = Duration(0)
    end: Annotated[Duration | None, key("0.5 s", positive=True)] = None


class DataLoader(Record, frozen=True, kw_only=True):
    """The recorded topics to load, and their names in the graph.

    If the document lists several recordings, `bag` is the first of them.

    Attributes:
        bag: The recording: the name of a dataset, or the path of a bag relative to this file. A map
            can also pin the content.
        bags: Several recordings instead of one, in the order of recording; their topics are merged.
        window: The part of the recording to use, relative to its first message.
        topics: The topics to load: the topic in the bag, and the topic in the graph. Other topics
            of the bag are ignored.
        publish_tf: Whether the recorded /tf is played with the inputs.
        publish_tf_static: Whether the recorded /tf_static is published before playing starts.
        real_time: Whether the preprocessors get the messages at the recorded times instead of as
            fast as they process them.
    """

    about = key(
        {"bag": "r2b_storage", "topics": {"/d455_1_rgb_image": "data_loader/image"}},
        snippets=(
            {
                "label": "data_loader",
                "body": {
                    "bag": "${1:r2b_storage}",
                    "topics": {"/${2:topic}": "data_loader/${3:name}"},
                },
            },
        ),
    )

    bag: Annotated[BagSource, key(hidden_default=True)] = BagSource()
    bags: Annotated[tuple[BagSource, ...], key(["./bags/part_1", "./bags/part_2"])] = ()
    window: Window = Window()
    topics: Annotated[
        dict[
            names.Topic,
            Annotated[
                names.Topic,
                key(
                    "data_loader/image",
                    description="The topic in the graph; a relative name is in the namespace of "
                    "the benchmark.",
                ),
            ],
        ],
        key(
            {"/d455_1_rgb_image": "data_loader/image"},
            topics=True,
            at_least=1,
            at_most=MAX_ENTRIES,
            unless_live=True,
        ),
    ] = {}
    publish_tf: bool = False
    publish_tf_static: bool = False
    real_time: bool = False

    @classmethod
    def from_keys(cls, keys: dict[str, Any]) -> "DataLoader":
        """Of several recordings, the first one is also *the* bag."""
        if keys.get("bags"):
            keys["bag"] = keys["bags"][0]
        return cls(**keys)

    @property
    def sources(self) -> tuple[BagSource, ...]:
        """Every recording, in the order of the document; none in a live benchmark."""
        return self.bags or ((self.bag,) if self.bag != BagSource() else ())


class Pairing(Record, frozen=True, kw_only=True):
    """Which messages of several inputs are one step.

    Attributes:
        slop: The largest difference between stamps of messages of one step; 0 s for equal stamps.
    """

    about = key({"slop": "10 ms"})

    slop: Annotated[Duration, key("10 ms")] = Duration(0)


class PlaybackInput(Record, frozen=True, kw_only=True):
    """A topic that is played to the graph.

    Attributes:
        source: The loaded or preprocessed topic that provides the messages.
        format: The type of its messages.
        qos: The QoS profile of the player's publisher. The name of a ROS profile, or a map.
        timestamp: header writes the time of playing into the header of each message; none leaves
            messages as recorded.
        pairing: Which messages of this input belong to a step; the default is 'playback.pairing'.
        rate: step plays one message in each step; recorded plays what was recorded between two
            steps between them, for an input with another rate, such as an IMU.
    """

    about = key(_IMAGE_INPUT)

    source: Annotated[names.Topic, key("buffer/image")] = msgspec.field(name="from")
    format: Annotated[names.MessageType, key("sensor_msgs/msg/Image")]
    qos: QoS = QoS()
    timestamp: Literal["header", "none"] = "header"
    pairing: Pairing | None = None
    rate: Literal["step", "recorded"] = "step"


class Timeline(Record, frozen=True, kw_only=True):
    """How recorded times are converted to times of playing.

    Attributes:
        speed: The speed of playing relative to the recording.
        translations: Delays of inputs: how much later than recorded they are played and stamped.
    """

    about = key({"speed": "50 %"})

    speed: Annotated[Share, key("50 %", "200 %", positive=True)] = Share(1.0)
    translations: Annotated[
        dict[names.Topic, Annotated[Duration, key("20 ms", description="The delay of one input.")]],
        key({"image": "20 ms"}, topics=True),
    ] = {}


class Playback(Record, frozen=True, kw_only=True):
    """How the buffered messages are played to the graph.

    Attributes:
        mode: looping repeats the buffered messages at the offered rate; sweeping plays them
            forwards and backwards in turn; timeline plays them at the recorded times; live plays
            nothing, for graphs with a source of their own.
        buffer: The number of messages to buffer for each input; 0 buffers all of the window.
        inputs: The topics that are played to the graph. All inputs of one step are played together,
            with the same stamp unless 'pairing' allows differences.
        unpaired: Messages without a partner of the same stamp in all other inputs are not played.
            With mode timeline, those whose stamp no recorded message has are not. refuse warns
            above 5 % of the messages of an input, and stops above 50 %; drop agrees to any number.
        timeline: With mode timeline: how recorded times are converted to times of playing.
        record_timeline: Whether the timeline follows the times at which the preprocessors published
            the messages, instead of the recorded times.
        tf: Whether stamps in /tf are shifted like those of other messages, or kept.
        pairing: Which messages of several inputs are one step. Differences of stamps within a step
            stay as recorded.
        clock: Whether the system time is published on /clock, 100 times per second, for nodes with
            'use_sim_time'. The stamps of played messages are of the same clock.
    """

    about = key({"mode": "looping", "buffer": 30, "inputs": {"image": _IMAGE_INPUT}})

    mode: Literal["timeline", "looping", "sweeping", "live"] = "looping"
    buffer: Annotated[int, key(30, 0, minimum=0)] = 0
    inputs: Annotated[
        dict[names.Topic, PlaybackInput],
        key(
            {"image": _IMAGE_INPUT},
            topics=True,
            at_least=1,
            at_most=MAX_ENTRIES,
            unless_live=True,
            snippets=(
                {
                    "label": "an input",
                    "body": {
                        "${1:topic}": {
                            "from": "buffer/${1:topic}",
                            "format": "${2:sensor_msgs/msg/Image}",
                        }
                    },
                },
            ),
        ),
    ] = {}
    unpaired: Literal["refuse", "drop"] = "refuse"
    timeline: Timeline = Timeline()
    record_timeline: bool = False
    tf: Literal["shift", "keep"] = "shift"
    pairing: Pairing = Pairing()
    clock: Annotated[bool, key(changes="graph")] = False
