"""dataset.json: where a synthetic dataset came from, written beside its bag."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import msgspec

from r2bspec.bags.recording import BagIndex, Window, WritableStorage
from r2bspec.untrusted.safe_json import read_json

RECORD_NAME = "dataset.json"
GROUND_TRUTH_NAME = "ground_truth.json"
DISPARITY_NAME = "disparity.npz"

_MAX_RECORD_BYTES = 16_000_000


class TopicRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One topic of a made dataset, with what its index cannot know from the storage."""

    type: str
    count: int
    rate_hz: float
    max_message_bytes: int


class DatasetRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The provenance of a made dataset.

    Attributes:
        format: tells this file from any other dataset.json.
        generator: version of the renderer.
        dataset: sequence name.
        window: stretch of the sequence that was made.
        storage: storage format.
        start_ns: start of the sequence, ns since the epoch: the origin of windows.
        topics: what was made.
        content_sha256: as `hash_content` computes it for all topics.
        file_bytes: size of each other file in the folder, to notice damage cheaply.
    """

    format: Literal["r2bspec-dataset-v1"] = "r2bspec-dataset-v1"
    generator: int
    dataset: str
    window: Window
    storage: WritableStorage
    start_ns: int
    topics: dict[str, TopicRecord]
    content_sha256: str
    file_bytes: dict[str, int]

    def complete_index(self, index: BagIndex) -> BagIndex:
        """Add to a storage's index the nominal rates, sizes and the origin of windows."""
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
    """The provenance of a bag folder, or None where r2bspec did not make it."""
    try:
        return read_json(folder / RECORD_NAME, DatasetRecord, max_bytes=_MAX_RECORD_BYTES)
    except (OSError, msgspec.MsgspecError):
        return None


def write_provenance(folder: Path, record: DatasetRecord) -> None:
    """Write dataset.json, formatted to be read.

    Raises:
        OSError: the folder cannot be written.
    """
    text = msgspec.json.format(msgspec.json.encode(record), indent=2)
    (folder / RECORD_NAME).write_bytes(text + b"\n")
