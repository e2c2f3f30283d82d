"""The catalogue of datasets, and the location of the bag that a spec names.

The synthetic sequences are named and shaped like the r2b dataset 2023.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from functools import cache
from pathlib import Path

import msgspec

from r2bspec.bags import recording
from r2bspec.bags.bag_writer import OFFERED_QOS
from r2bspec.datasets import rig
from r2bspec.diagnostics.quote import clip, did_you_mean, quote
from r2bspec.safe_io.file_search import near_path
from r2bspec.safe_io.safe_file import is_folder, is_there, names_in

DURATION_NS = 10_000_000_000

CACHE_KIND = "datasets"
"""The folder of datasets in the cache of the user."""

# 2023-03-14 15:00:00 UTC; the sequences lie an hour apart.
_FIRST_START_NS = 1_678_806_000_000_000_000
_HOUR_NS = 3_600_000_000_000


class Sequence(msgspec.Struct, frozen=True):
    """A sequence that can be rendered; it lasts `DURATION_NS`.

    Attributes:
        start_ns: time of its first messages, ns since the epoch.
        sources: its topics.
        description: what it shows, in a few words.
    """

    name: str
    start_ns: int
    sources: tuple[rig.TopicSource, ...]
    description: str


_NAMES = (
    *("r2b_lounge", "r2b_storage", "r2b_hallway", "r2b_datacenter"),
    *("r2b_cafe", "r2b_hideaway", "r2b_mezzanine", "r2b_hope"),
)

SEQUENCES: dict[str, Sequence] = {
    name: Sequence(
        name,
        _FIRST_START_NS + number * _HOUR_NS,
        rig.HOPE_TOPICS if name == "r2b_hope" else rig.ROBOT_TOPICS,
        "textured boards" + (" and an AprilTag" if name == "r2b_storage" else ""),
    )
    for number, name in enumerate(_NAMES)
}


def find_sequence(name: str) -> Sequence:
    """Return the sequence of that name.

    Raises:
        DataError: there is none (R2B307).
    """
    sequence = SEQUENCES.get(name)
    if sequence is None:
        raise _unknown_dataset(name, SEQUENCES)
    return sequence


def _unknown_dataset(name: str, known: Collection[str]) -> recording.DataError:
    """Return the error for an unknown dataset name."""
    close = did_you_mean(name, known)
    return recording.DataError(
        f"there is no dataset {quote(name)}",
        code="R2B307",
        hint=f"did you mean {close}?"
        if close
        else f"known datasets: {', '.join(sorted(known))}; a path needs a '/'",
    )


def select_sources(name: str, topics: Collection[str] | None) -> tuple[rig.TopicSource, ...]:
    """Return the requested topics of a sequence, sorted by name; None for all.

    Raises:
        DataError: R2B307, or R2B308 for a topic that the sequence does not have.
    """
    sources = {source.name: source for source in find_sequence(name).sources}
    if topics is None:
        return tuple(sources[topic] for topic in sorted(sources))
    topic_names = {topic if topic.startswith("/") else f"/{topic}" for topic in topics}
    for topic in sorted(topic_names - sources.keys()):
        raise recording.topic_not_found(f"dataset {name}", topic, sources)
    return tuple(sources[topic] for topic in sorted(topic_names))


def bounded_window(name: str, window: recording.TimeWindow | None) -> recording.TimeWindow:
    """Return a window with both ends, inside the sequence.

    Raises:
        DataError: the window is empty or leaves the sequence (R2B309).
    """
    window = window or recording.TimeWindow()
    end_ns = DURATION_NS if window.end_ns is None else window.end_ns
    if not 0 <= window.start_ns < end_ns <= DURATION_NS:
        raise recording.DataError(
            f"the window from {window.start_ns / 1e9:g} s to {end_ns / 1e9:g} s is not inside"
            f" dataset {name}, which lasts {DURATION_NS / 1e9:g} s",
            code="R2B309",
            hint="its start must be before its end, and both between"
            f" 0 s and {DURATION_NS / 1e9:g} s",
        )
    return recording.TimeWindow(start_ns=window.start_ns, end_ns=end_ns)


def message_times_ns(source: rig.TopicSource, window: recording.TimeWindow) -> list[int]:
    """Return the times of a topic's messages in a window, in ns after the sequence's start.

    Message k lies at k / rate, rounded down to whole ns.
    """
    assert window.end_ns is not None  # noqa: S101 -- callers pass what `bounded_window` gave
    first = -(-window.start_ns * source.rate_hz // 10**9)
    numbers = range(max(0, first - 1), window.end_ns * source.rate_hz // 10**9 + 2)
    times_ns = (number * 10**9 // source.rate_hz for number in numbers)
    return [time_ns for time_ns in times_ns if window.contains(time_ns)]


def describe(
    name: str,
    topics: Collection[str] | None = None,
    window: recording.TimeWindow | None = None,
) -> recording.BagIndex:
    """Return the index that the dataset will have in sqlite3, with exact counts.

    Nothing is rendered.

    Args:
        name: sequence name.
        topics: None for all.
        window: None for the whole sequence.

    Raises:
        DataError: R2B307, R2B308 or R2B309.
    """
    sequence = find_sequence(name)
    inside = bounded_window(name, window)
    infos = {}
    last_ns = inside.start_ns
    for source in select_sources(name, topics):
        times_ns = message_times_ns(source, inside)
        last_ns = max([last_ns, *times_ns[-1:]])
        infos[source.name] = recording.TopicInfo(
            name=source.name,
            type=source.type,
            count=len(times_ns),
            rate_hz=float(source.rate_hz),
            qos=OFFERED_QOS,
            max_message_bytes=source.message_bytes,
            first_ns=sequence.start_ns + times_ns[0] if times_ns else None,
            last_ns=sequence.start_ns + times_ns[-1] if times_ns else None,
        )
    return recording.BagIndex(
        name=name,
        storage="sqlite3",
        topics=infos,
        start_ns=sequence.start_ns,
        end_ns=sequence.start_ns + last_ns,
        message_count=sum(info.count for info in infos.values()),
        compression="message",
        synthetic=True,
    )


_MAX_NAME_LENGTH = 4095  # that of Linux
DATASETS_VARIABLE = "R2B_DATASETS"


def locate(bag: str, base_dir: Path) -> recording.BagLocation:
    """Decide whether a bag is a path, a real dataset or a synthetic dataset.

    A name with a ``/``, or that exists relative to `base_dir`, is a path. Anything else names a
    dataset: the folder of that name under ``$R2B_DATASETS`` if there is one, else the catalogue's.

    Args:
        bag: as written in the spec.
        base_dir: folder of the spec.

    Raises:
        DataError: the path does not exist (R2B301), the name is unknown (R2B307), or
            ``$R2B_DATASETS`` is no folder (R2B301).
    """
    if len(bag) > _MAX_NAME_LENGTH:
        raise recording.DataError(
            f"the name of a bag has {len(bag):,} characters: {clip(bag)}",
            code="R2B301",
            hint=f"a path has at most {_MAX_NAME_LENGTH:,}",
        )
    path = base_dir / _expanded(bag)
    if bag and is_there(path):
        return recording.BagLocation(kind="recorded", path=path)
    if "/" in bag:
        raise recording.DataError(
            f"{path} does not exist",
            code="R2B301",
            hint=near_path(_expanded(bag), base_dir)
            or f"paths are relative to {base_dir}; a dataset name has no '/'",
        )
    return locate_dataset(bag)


def locate_dataset(name: str) -> recording.BagLocation:
    """Find a dataset by its name: the recorded dataset if there is one, else the synthetic one.

    Raises:
        DataError: R2B307; R2B301 where ``$R2B_DATASETS`` is no folder.
    """
    real = _datasets_folder()
    if real is not None and name and is_there(real / name):
        return recording.BagLocation(kind="recorded", path=real / name, dataset=name)
    if name not in SEQUENCES:
        raise _unknown_dataset(name, known_datasets())
    return recording.BagLocation(kind="synthetic", dataset=name)


def index(location: recording.BagLocation) -> recording.BagIndex:
    """Index a located bag; a synthetic one is not rendered.

    Raises:
        DataError: as `index_bag`.
    """
    if location.path is not None:
        from r2bspec.bags.bag_index import index_bag

        return index_bag(location.path)
    return _whole_index(location.dataset or "")


_whole_index = cache(describe)


def known_datasets() -> tuple[str, ...]:
    """Return the names of all synthetic and recorded datasets, sorted.

    Raises:
        DataError: ``$R2B_DATASETS`` is no folder (R2B301).
    """
    real = _datasets_folder()
    recorded = [name for name in names_in(real) if is_folder(real / name)] if real else []
    return tuple(sorted({*SEQUENCES, *recorded}))


def _expanded(path: str) -> str:
    """Return a path with the home folder in place of ``~``."""
    return os.path.expanduser(path)  # noqa: PTH111 - that of pathlib raises for unknown users


def _datasets_folder() -> Path | None:
    """Return the folder of recorded datasets; None if the variable is not set."""
    value = os.environ.get(DATASETS_VARIABLE) or ""
    if not value:
        return None
    folder = Path(_expanded(value))
    if not is_folder(folder):
        # The synthetic data would be another measurement than the one requested.
        raise recording.DataError(
            f"${DATASETS_VARIABLE} is {folder}, which is not a folder",
            code="R2B301",
            hint="set it to the folder of the r2b bags, or unset it",
        )
    return folder
