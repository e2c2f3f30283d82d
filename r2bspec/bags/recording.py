"""Frozen values that describe recorded data; indexes and windows serialise to JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import msgspec

WritableStorage = Literal["sqlite3", "mcap"]
"""In which formats datasets are written."""


class TopicInfo(msgspec.Struct, frozen=True, kw_only=True):
    """One topic of a bag.

    Attributes:
        name: as recorded, usually with a leading slash.
        type: normalised to ``package/msg/Name``.
        count: messages in the bag.
        rate_hz: nominal for synthetic bags; the mean over the bag's length for recorded ones;
            zero where fewer than two messages leave it unknown.
        serialization: usually ``cdr``.
        qos: the offered profiles as the bag's metadata writes them, or empty.
        max_message_bytes: size of the largest serialised message, encapsulation included;
            None where only reading the messages would tell.
    """

    name: str
    type: str
    count: int
    rate_hz: float
    serialization: str = "cdr"
    qos: str = ""
    max_message_bytes: int | None = None


class BagIndex(msgspec.Struct, frozen=True, kw_only=True):
    """The index of a bag, without message bodies.

    Attributes:
        name: dataset name, or the bag folder's name.
        storage: name of the format of the storage files, in `BAG_FORMATS`.
        topics: by recorded name, sorted.
        start_ns: origin of windows, ns since the epoch. For recorded bags the first message's
            time; for synthetic ones the start of the sequence, also where the made window
            begins later. Zero for a bag without messages.
        end_ns: time of the last message.
        message_count: over all topics.
        files: storage file names, in recorded order; empty for what is not made yet.
        compression: how the storage is compressed, as metadata.yaml says; chunks of MCAP and
            ROS 1 files are the format's own business.
        synthetic: whether r2bspec renders (or rendered) it.
        notes: harmless discrepancies, as text.
    """

    name: str
    storage: str
    topics: dict[str, TopicInfo]
    start_ns: int
    end_ns: int
    message_count: int
    files: tuple[str, ...] = ()
    compression: Literal["none", "message", "file"] = "none"
    synthetic: bool = False
    notes: tuple[str, ...] = ()

    @property
    def duration_ns(self) -> int:
        """Length of the recording in ns, from its start to its last message."""
        return self.end_ns - self.start_ns

    def find(self, topic: str) -> TopicInfo | None:
        """The topic of that name; a leading slash is optional."""
        exact = self.topics.get(topic)
        if exact is not None:
            return exact
        return self.topics.get(topic[1:] if topic.startswith("/") else f"/{topic}")


class Window(msgspec.Struct, frozen=True, kw_only=True):
    """A half-open interval of time, in ns after the start of the bag.

    Attributes:
        start_ns: first instant inside.
        end_ns: first instant after it; None for the end of the bag.
    """

    start_ns: int = 0
    end_ns: int | None = None

    def contains(self, offset_ns: int) -> bool:
        """Whether an instant, in ns after the start of the bag, lies inside."""
        return self.start_ns <= offset_ns and (self.end_ns is None or offset_ns < self.end_ns)


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """One recorded message: the CDR bytes as a publisher sent them, 4 bytes of header first.

    Attributes:
        topic: as recorded.
        time_ns: when it was recorded, ns since the epoch.
        data: uncompressed CDR.
    """

    topic: str
    time_ns: int
    data: bytes


class BagLocation(msgspec.Struct, frozen=True, kw_only=True):
    """The location of a bag.

    Attributes:
        kind: ``recorded`` for files, ``synthetic`` for a sequence of the catalogue.
        path: bag folder or storage file; None for synthetic ones.
        dataset: dataset name; None where the spec gave a path.
    """

    kind: Literal["recorded", "synthetic"]
    path: Path | None = None
    dataset: str | None = None


class SyntheticDataset(msgspec.Struct, frozen=True, kw_only=True):
    """A synthetic dataset on disk.

    Attributes:
        path: bag folder; `ground_truth.json` and `dataset.json` lie in it.
        content_sha256: hash of the uncompressed content, as `ContentHash` gives it.
        made: False if it was found in the cache.
        damaged: whether the cache had a damaged one, which was replaced.
    """

    path: Path
    content_sha256: str
    made: bool
    damaged: bool = False
