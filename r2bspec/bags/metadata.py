"""Parsing metadata.yaml, which rosbag2 writes to the folder of its storage files."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path, PurePath
from typing import Any

import msgspec
import yaml

from r2bspec.bags.recording import SUFFIXES, DataError, TopicInfo, error_hint, error_text
from r2bspec.safe_io import limits
from r2bspec.safe_io.safe_file import open_regular, read_text
from r2bspec.safe_io.safe_yaml import load_texts

METADATA_NAME = "metadata.yaml"

_LFS_MAGIC = b"version https://git-lfs.github.com/spec/"
_MAX_VERSION = 9
_SHOWN_BAGS = 5
_OLD_TYPE = re.compile(r"(?P<package>[^/]+)/(?P<name>[^/]+)")


class FileSpan(msgspec.Struct, frozen=True, kw_only=True):
    """The times of the first and the last message of a storage file, in ns."""

    name: str
    start_ns: int
    end_ns: int


class BagMetadata(msgspec.Struct, frozen=True, kw_only=True):
    """metadata.yaml, reduced to what r2bspec uses; times in ns.

    Attributes:
        spans: one for each file that has messages; empty before version 5.
    """

    storage: str
    files: tuple[str, ...]
    start_ns: int
    duration_ns: int
    topics: tuple[TopicInfo, ...]
    compression_format: str
    compression_mode: str
    spans: tuple[FileSpan, ...]


def normalise_type(name: str) -> str:
    """Write ``package/Name``, as bags of early ROS 2 have it, as ``package/msg/Name``."""
    match = _OLD_TYPE.fullmatch(name)
    return f"{match['package']}/msg/{match['name']}" if match else name


def check_not_lfs_pointer(path: Path) -> None:
    """Raise DataError (R2B305) if a file is a Git LFS pointer.

    Raises:
        OSError: the file cannot be opened.
    """
    with open_regular(path) as stream:
        head = stream.read(len(_LFS_MAGIC))
    if head == _LFS_MAGIC:
        raise DataError(
            f"{path} is a Git LFS pointer, not the recording itself",
            code="R2B305",
            hint="fetch the file with 'git lfs install && git lfs pull' in its repository",
        )


def read_metadata(folder: Path) -> BagMetadata:
    """Parse the metadata.yaml of a bag folder.

    Raises:
        DataError: it is missing, is not YAML, is an LFS pointer, or lacks a required key.
    """
    path = folder / METADATA_NAME
    reindex = f"write a new one from the storage files with 'ros2 bag reindex {folder}'"
    try:
        check_not_lfs_pointer(path)
        text = read_text(path, max_bytes=limits.MAX_METADATA_BYTES)
    except FileNotFoundError:
        named = (METADATA_NAME, *(f"*{suffix}" for suffix in SUFFIXES.values()))
        bags = sorted({part.parent.name for name in named for part in folder.glob(f"*/{name}")})
        raise _unusable(
            f"{folder} is no complete rosbag: it has no {METADATA_NAME}",
            f"name a bag in it: {', '.join(bags[:_SHOWN_BAGS])}"
            if bags
            else "give the folder of a bag, or its storage file",
        ) from None
    except OSError as error:
        hint = error_hint(error, reindex)
        raise _unusable(f"{path} cannot be read: {error_text(error)}", hint) from error
    try:
        # Every scalar is a string, so a topic 'on' or '010' is not converted.
        document: Any = load_texts(text)
        return _from_document(document["rosbag2_bagfile_information"])
    except yaml.YAMLError as error:
        raise _unusable(f"{path} is not valid YAML: {error_text(error)}", reindex) from error
    except KeyError as error:
        raise _unusable(f"{path} has no key {error}", reindex) from error
    except (TypeError, ValueError, AttributeError, IndexError, RecursionError) as error:
        raise _unusable(f"{path} was not written by rosbag2: {error}", reindex) from error


def _unusable(message: str, hint: str) -> DataError:
    return DataError(message, code="R2B302", hint=hint)


def _from_document(info: Any) -> BagMetadata:
    """Build the value; missing keys and wrong kinds raise what Python raises for them."""
    version = _int(info["version"])
    if version > _MAX_VERSION:
        raise ValueError(f"its version is {version}, the newest supported one is {_MAX_VERSION}")
    compression_mode = info.get("compression_mode", "").lower()
    files = tuple(_inside(PurePath(name)) for name in info["relative_file_paths"] or ())
    metadata = BagMetadata(
        # The names of the files are right where recorders leave it empty, out, or write another.
        storage=storage_of(files) or info.get("storage_identifier", ""),
        files=files,
        start_ns=_int(info["starting_time"]["nanoseconds_since_epoch"]),
        duration_ns=_int(info["duration"]["nanoseconds"]),
        topics=tuple(_topic(entry) for entry in info["topics_with_message_count"] or ()),
        compression_format=info.get("compression_format", ""),
        compression_mode="" if compression_mode == "none" else compression_mode,
        spans=tuple(
            _span(entry) for entry in info.get("files") or () if _int(entry["message_count"]) > 0
        ),
    )
    # A name may be a list.
    return msgspec.convert(msgspec.to_builtins(metadata), BagMetadata)


def storage_of(files: Iterable[str]) -> str:
    """Return the storage format of files by their names; empty if no name tells it."""
    suffixes = {suffix: storage for storage, suffix in SUFFIXES.items()}
    names = [PurePath(name.removesuffix(".zstd")) for name in files]
    return next((suffixes[name.suffix] for name in names if name.suffix in suffixes), "")


def _inside(path: PurePath) -> str:
    """Return the place of a file in the folder of a bag."""
    is_inside = not path.is_absolute() and ".." not in path.parts
    return path.as_posix() if is_inside else path.name


def _int(text: str) -> int:
    """Return a number of 64 bits, as rosbag2 writes them."""
    number = int(text)
    if not -(2**63) <= number < 2**63:
        raise ValueError("a number in it has more than 64 bits")
    return number


def _span(entry: Any) -> FileSpan:
    start_ns = _int(entry["starting_time"]["nanoseconds_since_epoch"])
    return FileSpan(
        name=PurePath(entry["path"]).name,
        start_ns=start_ns,
        end_ns=start_ns + _int(entry["duration"]["nanoseconds"]),
    )


def _topic(entry: Any) -> TopicInfo:
    topic = entry["topic_metadata"]
    qos = topic.get("offered_qos_profiles", "")
    return TopicInfo(
        name=topic["name"],
        type=normalise_type(topic["type"]),
        serialization=topic["serialization_format"],
        # Version 9 nests the profiles instead of quoting them as a block of YAML.
        qos=qos if isinstance(qos, str) else yaml.safe_dump(qos, sort_keys=False).strip(),
        count=_int(entry["message_count"]),
    )
