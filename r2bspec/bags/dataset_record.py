"""dataset.json: the provenance of a synthetic dataset, in its bag folder."""

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
    """One topic of a synthetic dataset, with values that are not in its storage."""

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
        topics: that were rendered.
        content_sha256: as `ContentHash` computes it for all topics.
        file_bytes: size of each other file in the folder, for a fast check for damage.
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
    """The provenance of a bag folder; None if r2bspec did not synthesise it."""
    try:
        return read_json(folder / RECORD_NAME, DatasetRecord, max_bytes=_MAX_RECORD_BYTES)
    except (OSError, msgspec.MsgspecError):
        return None


def write_provenance(folder: Path, record: DatasetRecord) -> None:
    """Write dataset.json, formatted.

    Raises:
        OSError: the folder cannot be written.
    """
    text = msgspec.json.format(msgspec.json.encode(record), indent=2)
    (folder / RECORD_NAME).write_bytes(text + b"\n")
