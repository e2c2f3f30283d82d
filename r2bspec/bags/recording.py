"""Frozen values that describe recorded data, the storage formats, and errors with hints.

Indexes and windows serialise to JSON. Among the values is dataset.json, the provenance of a
synthetic dataset, in its bag folder.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, Literal

import msgspec

from r2bspec.diagnostics.quote import did_you_mean, printable
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.safe_io.limits import MAX_METADATA_BYTES
from r2bspec.safe_io.safe_json import read_json


class DataError(R2bspecError):
    """A bag or dataset cannot be used as requested.

    The message names the file or the dataset; `hint` is the remedy.
    """

    code = "R2B301"
    exit_code = ExitStatus.USAGE

    def __init__(self, message: str, *, hint: str = "", code: str | None = None) -> None:
        # Names in bags may contain control characters, and this is printed to a terminal.
        super().__init__(printable(message), hint=printable(hint), code=code)


_DAMAGED_HINT: Final = "the file is damaged or incomplete; copy or record it again"


def unreadable(path: Path, reason: str, hint: str = "") -> DataError:
    """Return the error for a storage file that cannot be read (R2B304)."""
    text = f"{path} cannot be read: {reason}"
    return DataError(text, code="R2B304", hint=hint or _DAMAGED_HINT)


def not_cdr(owner: str, topic: TopicInfo) -> DataError:
    """Return the error for a topic whose messages cannot be played (R2B306)."""
    return DataError(
        f"{owner} has {topic.name} as {topic.serialization}; only cdr can be played",
        code="R2B306",
        hint="record the topic with ROS 2, or convert it with the tools of its writer; "
        "other topics of the bag can be loaded",
    )


def topic_not_found(owner: str, topic: str, topics: Iterable[str]) -> DataError:
    """Return the error for a topic that a recording does not have (R2B308)."""
    names = sorted(topics)
    close = did_you_mean(topic, names)
    return DataError(
        f"{owner} has no topic {topic}",
        code="R2B308",
        hint=f"did you mean {close}?" if close else f"its topics: {', '.join(names) or 'none'}",
    )


def error_text(error: Exception) -> str:
    """Return the message of an error of the system or of a parser, on one line."""
    if isinstance(error, OSError) and error.errno is not None:
        return os.strerror(error.errno)
    return " ".join(str(error).split()) or type(error).__name__


def error_hint(error: Exception, default: str = _DAMAGED_HINT) -> str:
    """Return the hint for an error: of the system, or else `default`, for damaged files."""
    number = error.errno if isinstance(error, OSError) else None
    if number in {errno.EACCES, errno.EPERM}:
        return "you do not have permission to read it; see 'ls -l'"
    if number in {errno.ENOSPC, errno.EDQUOT}:
        return "compressed files are unpacked while they are read: free space in $TMPDIR"
    if number in {errno.EMFILE, errno.ENFILE}:
        return "too many files are open; see 'ulimit -n'"
    return default


SUFFIXES: Final = {"sqlite3": ".db3", "mcap": ".mcap"}
"""The suffix of the files of each storage format, by its name in metadata.yaml."""

_AND: Final = " and "

SUFFIXES_TEXT: Final = " or ".join(SUFFIXES.values())


WritableStorage = Literal["sqlite3", "mcap"]
"""In which formats datasets are written."""


class TopicInfo(msgspec.Struct, frozen=True, kw_only=True):
    """A topic of a bag.

    Attributes:
        name: as recorded, usually with a leading slash.
        type: normalised to ``package/msg/Name``.
        count: messages in the bag.
        rate_hz: nominal for synthetic bags; for recorded ones the mean from the topic's first to
            its last message, or over the bag's length, which is a lower bound, where these are
            unknown; zero with fewer than two messages.
        serialization: usually ``cdr``.
        qos: the offered profiles as the bag's metadata writes them, or empty.
        max_message_bytes: size of the largest serialised message, encapsulation included;
            None where only reading the messages would tell.
        first_ns: time of the first message, ns since the epoch; None if unknown.
        last_ns: likewise of the last one.
    """

    name: str
    type: str
    count: int
    rate_hz: float = 0.0
    serialization: str = "cdr"
    qos: str = ""
    max_message_bytes: int | None = None
    first_ns: int | None = None
    last_ns: int | None = None

    @property
    def type_text(self) -> str:
        """The type, and the encoding if it cannot be played."""
        if self.serialization == "cdr":
            return self.type or "no type"
        return f"{self.type or 'no type'} as {self.serialization}"

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """The times of the first and the last message, ns since the epoch; None if unknown."""
        if self.first_ns is None or self.last_ns is None:
            return None
        return self.first_ns, self.last_ns


class BagIndex(msgspec.Struct, frozen=True, kw_only=True):
    """The index of a bag, without message bodies.

    Attributes:
        name: dataset name, or the bag folder's name.
        storage: name of the format of the storage files, in `SUFFIXES`.
        topics: by recorded name, sorted.
        start_ns: origin of windows, ns since the epoch. For recorded bags the first message's
            time; for synthetic ones the start of the sequence, also where the made window
            begins later. Zero for a bag without messages.
        end_ns: time of the last message.
        message_count: over all topics.
        files: storage file names, in recorded order; empty for what is not made yet.
        compression: how the storage is compressed, as metadata.yaml says; chunks of MCAP are the
            format's own business.
        synthetic: whether r2bspec renders (or rendered) it.
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

    @property
    def duration_ns(self) -> int:
        """Length of the recording in ns, from its start to its last message."""
        return self.end_ns - self.start_ns

    def find(self, topic: str) -> TopicInfo | None:
        """Return the topic of that name; a leading slash is optional."""
        exact = self.topics.get(topic)
        if exact is not None:
            return exact
        return self.topics.get(topic[1:] if topic.startswith("/") else f"/{topic}")

    def types(self, topics: Iterable[str]) -> dict[str, str]:
        """Return the types of the topics that it has, by the given names."""
        return {topic: info.type for topic in topics if (info := self.find(topic)) is not None}


class TimeWindow(msgspec.Struct, frozen=True, kw_only=True):
    """A half-open interval of time, in ns after the start of the bag.

    Attributes:
        start_ns: first instant inside.
        end_ns: first instant after it; None for the end of the bag.
    """

    start_ns: int = 0
    end_ns: int | None = None

    def contains(self, offset_ns: int) -> bool:
        """Return True if an instant, in ns after the start of the bag, lies inside."""
        return self.start_ns <= offset_ns and (self.end_ns is None or offset_ns < self.end_ns)


class Selection(msgspec.Struct, frozen=True, kw_only=True):
    """Messages of topics with start <= time < stop, in ns since the epoch; None is no bound."""

    names: frozenset[str]
    start_ns: int | None = None
    stop_ns: int | None = None


class RecordedMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A recorded message: the CDR bytes of its publisher, with 4 bytes of header first.

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
        path: bag folder, with its `dataset.json`.
        content_sha256: hash of the uncompressed content, as `ContentHash` gives it.
        made: False if it was found in the cache.
        damaged: whether the cache had a damaged one, which was replaced.
    """

    path: Path
    content_sha256: str
    made: bool
    damaged: bool = False


RECORD_NAME = "dataset.json"


class TopicRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A topic of a synthetic dataset, with values that are not in its storage."""

    type: str
    count: int
    rate_hz: float
    max_message_bytes: int


class DatasetRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The provenance of a synthetic dataset.

    Attributes:
        format: distinguishes this file from any other dataset.json.
        generator: version of the renderer.
        dataset: sequence name.
        window: part of the sequence that was rendered.
        storage: storage format.
        start_ns: start of the sequence, ns since the epoch: the origin of windows.
        topics: the topics that were rendered.
        content_sha256: as `ContentHash` computes it for all topics.
        file_bytes: size of each other file in the folder, for a fast check for damage.
    """

    format: Literal["r2bspec-dataset-v1"] = "r2bspec-dataset-v1"
    generator: int
    dataset: str
    window: TimeWindow
    storage: WritableStorage
    start_ns: int
    topics: dict[str, TopicRecord]
    content_sha256: str
    file_bytes: dict[str, int]

    def complete_index(self, index: BagIndex) -> BagIndex:
        """Add the nominal rates, the sizes and the origin of windows to an index."""
        topics = {
            name: (
                info
                if (record := self.topics.get(name)) is None
                else msgspec.structs.replace(
                    info, rate_hz=record.rate_hz, max_message_bytes=record.max_message_bytes
                )
            )
            for name, info in index.topics.items()
        }
        return msgspec.structs.replace(
            index, name=self.dataset, topics=topics, start_ns=self.start_ns, synthetic=True
        )


def read_provenance(folder: Path) -> DatasetRecord | None:
    """Return the provenance of a bag folder; None if r2bspec did not synthesise it."""
    try:
        return read_json(folder / RECORD_NAME, DatasetRecord, max_bytes=MAX_METADATA_BYTES)
    except (OSError, msgspec.MsgspecError):
        return None


def write_provenance(folder: Path, record: DatasetRecord) -> None:
    """Write dataset.json, formatted.

    Raises:
        OSError: the folder cannot be written.
    """
    text = msgspec.json.format(msgspec.json.encode(record), indent=2)
    (folder / RECORD_NAME).write_bytes(text + b"\n")


def merge_indexes(indexes: Sequence[BagIndex]) -> BagIndex | None:
    """Return the index of all recordings together, from the first message to the last.

    The message counts of a topic in several recordings are added; its type is that of the first.
    None without recordings.
    """
    if len(indexes) < 2:
        return indexes[0] if indexes else None
    filled = [index for index in indexes if index.message_count] or list(indexes)
    start_ns = min(index.start_ns for index in filled)
    end_ns = max(index.end_ns for index in filled)
    infos = [info for index in indexes for info in index.topics.values()]
    return msgspec.structs.replace(
        indexes[0],
        name=" + ".join(index.name for index in indexes),
        topics=merge_topics(infos, end_ns - start_ns),
        start_ns=start_ns,
        end_ns=end_ns,
        message_count=sum(index.message_count for index in indexes),
        files=tuple(file for index in indexes for file in index.files),
        synthetic=all(index.synthetic for index in indexes),
    )


def _all_of(known: str, name: str) -> str:
    names = known.split(_AND) if known else []
    return _AND.join([*names, *({name} - {"", *names})])


def merge_topics(infos: Iterable[TopicInfo], duration_ns: int) -> dict[str, TopicInfo]:
    """Return the topics by name, sorted; message counts of the same topic are added.

    Types and encodings that differ are all named, so that none is taken for another. Everything
    else is that of the first entry. An unknown rate is the mean from the first to the last message
    or, if these are unknown, over the duration.
    """
    merged: dict[str, TopicInfo] = {}
    for info in infos:
        before = merged.get(info.name)
        count = info.count + (before.count if before else 0)
        sizes = (info.max_message_bytes, before.max_message_bytes if before else 0)
        spans = [topic.span_ns for topic in (before, info) if topic is not None and topic.count]
        known = [span for span in spans if span is not None]
        first_ns = last_ns = None
        if known and len(known) == len(spans):
            first_ns, last_ns = min(first for first, _ in known), max(last for _, last in known)
        over_ns = duration_ns if first_ns is None or last_ns is None else last_ns - first_ns
        mean_hz = (count - 1) * 1e9 / over_ns if count > 1 and over_ns > 0 else 0.0
        merged[info.name] = msgspec.structs.replace(
            before or info,
            type=_all_of(before.type if before else "", info.type),
            serialization=_all_of(before.serialization if before else "", info.serialization),
            count=count,
            rate_hz=mean_hz if before else info.rate_hz or mean_hz,
            max_message_bytes=None if None in sizes else max(size for size in sizes if size),
            first_ns=first_ns,
            last_ns=last_ns,
        )
    return dict(sorted(merged.items()))
