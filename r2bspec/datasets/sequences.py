"""The static catalogue of the synthetic sequences, named and shaped like the r2b dataset 2023."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import msgspec

from r2bspec.bags.errors import DATASET_UNKNOWN, WINDOW_OUTSIDE_BAG, DataError, topic_not_found
from r2bspec.bags.recording import BagIndex, TopicInfo, Window, WritableStorage
from r2bspec.datasets.scene.rig import HOPE_TOPICS, ROBOT_TOPICS, TopicSource, message_bytes
from r2bspec.diagnostics.quote import quote

DURATION_NS = 10_000_000_000

# 2023-03-14 15:00:00 UTC; the sequences lie an hour apart.
_FIRST_START_NS = 1_678_806_000_000_000_000
_HOUR_NS = 3_600_000_000_000

# As metadata.yaml of version 8 writes reliable, keep last 10, volatile.
OFFERED_QOS = (
    "- avoid_ros_namespace_conventions: false\n"
    "  deadline: {nsec: 0, sec: 0}\n"
    "  depth: 10\n"
    "  durability: 2\n"
    "  history: 1\n"
    "  lifespan: {nsec: 0, sec: 0}\n"
    "  liveliness: 1\n"
    "  liveliness_lease_duration: {nsec: 0, sec: 0}\n"
    "  reliability: 1"
)


class Sequence(msgspec.Struct, frozen=True):
    """A sequence that can be rendered; it lasts `DURATION_NS`.

    Attributes:
        start_ns: time of its first messages, ns since the epoch.
        sources: its topics.
        description: what it shows, in a few words.
    """

    name: str
    start_ns: int
    sources: tuple[TopicSource, ...]
    description: str


def _catalogue() -> Iterator[Sequence]:
    robots = {
        "r2b_lounge": "a lounge with low tables",
        "r2b_storage": "a storage room; a crate carries an AprilTag",
        "r2b_hallway": "a long, narrow hallway",
        "r2b_datacenter": "rows of racks",
        "r2b_cafe": "a cafe with a counter",
        "r2b_hideaway": "a small, cluttered room",
        "r2b_mezzanine": "a wide, high hall",
    }
    for place, (name, description) in enumerate(robots.items()):
        yield Sequence(name, _FIRST_START_NS + place * _HOUR_NS, ROBOT_TOPICS, description)
    yield Sequence(
        "r2b_hope", _FIRST_START_NS + len(robots) * _HOUR_NS, HOPE_TOPICS, "boxes on a table"
    )


SEQUENCES: dict[str, Sequence] = {sequence.name: sequence for sequence in _catalogue()}


def find_sequence(name: str) -> Sequence:
    """The sequence of that name.

    Raises:
        DataError: there is none (R2B307).
    """
    sequence = SEQUENCES.get(name)
    if sequence is None:
        raise unknown_dataset_error(name, SEQUENCES)
    return sequence


def unknown_dataset_error(name: str, known: Collection[str]) -> DataError:
    """The error for an unknown dataset name."""
    import difflib

    close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return DataError(
        f"there is no dataset {quote(name)}",
        code=DATASET_UNKNOWN,
        hint=f"did you mean {close[0]}?"
        if close
        else f"known datasets: {', '.join(sorted(known))}; a path needs a '/'",
    )


def select_sources(name: str, topics: Collection[str] | None) -> tuple[TopicSource, ...]:
    """The requested topics of a sequence, sorted by name; None for all.

    Raises:
        DataError: R2B307, or R2B308 for a topic that the sequence does not have.
    """
    sources = {source.name: source for source in find_sequence(name).sources}
    if topics is None:
        return tuple(sources[topic] for topic in sorted(sources))
    wanted = {topic if topic.startswith("/") else f"/{topic}" for topic in topics}
    for topic in sorted(wanted - sources.keys()):
        raise topic_not_found(f"dataset {name}", topic, sources)
    return tuple(sources[topic] for topic in sorted(wanted))


def bounded_window(name: str, window: Window | None) -> Window:
    """A window with both ends, inside the sequence.

    Raises:
        DataError: the window is empty or leaves the sequence (R2B309).
    """
    window = window or Window()
    end_ns = DURATION_NS if window.end_ns is None else window.end_ns
    if not 0 <= window.start_ns < end_ns <= DURATION_NS:
        raise DataError(
            f"the window from {window.start_ns / 1e9:g} s to {end_ns / 1e9:g} s is not inside"
            f" dataset {name}, which lasts {DURATION_NS / 1e9:g} s",
            code=WINDOW_OUTSIDE_BAG,
            hint="its start must be before its end, and both between"
            f" 0 s and {DURATION_NS / 1e9:g} s",
        )
    return Window(start_ns=window.start_ns, end_ns=end_ns)


def message_times_ns(source: TopicSource, window: Window) -> list[int]:
    """Times of a topic's messages in a bounded window, in ns after the sequence's start.

    Message k lies at k / rate, rounded down to whole ns.
    """
    assert window.end_ns is not None  # noqa: S101 -- callers pass what `bounded_window` gave
    first = -(-window.start_ns * source.rate_hz // 10**9)
    times = []
    for number in range(max(0, first - 1), window.end_ns * source.rate_hz // 10**9 + 2):
        time_ns = number * 10**9 // source.rate_hz
        if window.contains(time_ns):
            times.append(time_ns)
    return times


def describe(
    name: str,
    topics: Collection[str] | None = None,
    window: Window | None = None,
    *,
    storage: WritableStorage = "sqlite3",
) -> BagIndex:
    """The index that the dataset will have, with exact counts; nothing is rendered.

    Args:
        name: sequence name.
        topics: None for all.
        window: None for the whole sequence.
        storage: format that would be written.

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
        infos[source.name] = TopicInfo(
            name=source.name,
            type=source.type,
            count=len(times_ns),
            rate_hz=float(source.rate_hz),
            qos=OFFERED_QOS,
            max_message_bytes=message_bytes(source),
        )
    return BagIndex(
        name=name,
        storage=storage,
        topics=infos,
        start_ns=sequence.start_ns,
        end_ns=sequence.start_ns + last_ns,
        message_count=sum(info.count for info in infos.values()),
        compression="message" if storage == "sqlite3" else "none",
        synthetic=True,
    )
