"""Making a synthetic dataset: the requested topics and window, in a cache for all processes."""

from __future__ import annotations

import hashlib
import os
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TypeVar

import msgspec

from r2bspec.bags import recording
from r2bspec.bags.bag_writer import write_bag
from r2bspec.bags.integrity import ContentHash
from r2bspec.datasets import catalogue
from r2bspec.datasets.rig import TopicSource
from r2bspec.datasets.scenes import find_scene
from r2bspec.datasets.sensors import render_message
from r2bspec.safe_io.cache_folder import cache_or_temporary_folder
from r2bspec.safe_io.private_files import private_files, temporary_folder

# Raise it whenever the rendered bytes change: caches are keyed by it.
GENERATOR_VERSION = 4

Progress = Callable[[int, int], None]

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")

# Frames are large: more in flight than this would cost memory and gain nothing.
_MAX_WORKERS = 4


class _CacheKey(msgspec.Struct, frozen=True, kw_only=True):
    """All that decides a dataset's bytes; hashed, it is the cache key."""

    generator: int
    dataset: str
    topics: tuple[str, ...]
    window: recording.TimeWindow
    storage: recording.WritableStorage

    @property
    def name(self) -> str:
        """Name of the cache entry."""
        return f"{self.dataset}-{hashlib.sha256(msgspec.json.encode(self)).hexdigest()[:16]}"


def make(
    dataset: str,
    topics: Collection[str] | None = None,
    window: recording.TimeWindow | None = None,
    *,
    storage: recording.WritableStorage = "sqlite3",
    cache_dir: Path | None = None,
    progress: Progress | None = None,
) -> recording.SyntheticDataset:
    """Synthesise a dataset, or find it in the cache.

    An incomplete dataset in the cache is created again. If another process synthesises the same
    dataset, this function waits for it. A killed process leaves no incomplete dataset.

    Args:
        dataset: name of a sequence.
        topics: None for all.
        window: None for the whole sequence.
        storage: sqlite3 with each message compressed, as the real bags are, or mcap.
        cache_dir: None for the user's cache folder.
        progress: called with steps done and steps in all; not called for a cached dataset.

    Raises:
        DataError: an unknown dataset or topic, a window outside it, or a disk that is full or
            not writable (R2B307, R2B308, R2B309, R2B311).
    """
    sources = catalogue.select_sources(dataset, topics)
    if not sources:
        message = f"no topic of dataset {dataset} is selected"
        raise recording.DataError(message, code="R2B308", hint="select at least one topic")
    cache_key = _CacheKey(
        generator=GENERATOR_VERSION,
        dataset=dataset,
        topics=tuple(source.name for source in sources),
        window=catalogue.bounded_window(dataset, window),
        storage=storage,
    )
    root = cache_dir or cache_or_temporary_folder(catalogue.CACHE_KIND)
    final = root / cache_key.name
    record, was_damaged = _cached_record(final), False
    made = record is None
    if record is None:
        with private_files(), _write_errors(root), _entry_lock(root, cache_key.name):
            record = _cached_record(final)
            made, was_damaged = record is None, final.exists()
            if record is None:
                with temporary_folder("dataset", root) as scratch:
                    record = _build(scratch / cache_key.name, cache_key, sources, progress)
                    if was_damaged:
                        # It is moved away, because only an empty folder can be replaced.
                        final.rename(scratch / "damaged")
                    (scratch / cache_key.name).rename(final)
    return recording.SyntheticDataset(
        path=final,
        content_sha256=record.content_sha256,
        made=made,
        damaged=made and was_damaged,
    )


@contextmanager
def _entry_lock(root: Path, name: str) -> Iterator[None]:
    """Hold the lock of an entry of the cache, which ends with the process; wait for others."""
    from filelock import FileLock

    (root / ".locks").mkdir(parents=True, exist_ok=True)
    with FileLock(root / ".locks" / f"{name}.lock"):
        yield


@contextmanager
def _write_errors(root: Path) -> Iterator[None]:
    """Report a full or read-only disk as DataError (R2B311)."""
    import sqlite3

    try:
        yield
    except (OSError, sqlite3.Error) as error:
        errno = getattr(error, "errno", None)
        reason = str(error) if errno is None else os.strerror(errno)
        raise recording.DataError(
            f"the dataset cannot be written to {root}: {reason}",
            code="R2B311",
            hint="free space on this disk, or select another folder with XDG_CACHE_HOME",
        ) from error


def _cached_record(folder: Path) -> recording.DatasetRecord | None:
    """Return the record of a cached dataset whose files have their sizes; None if there is none."""
    record = recording.read_provenance(folder)
    if record is None:
        return None
    sizes = {path.name: path.stat().st_size for path in folder.iterdir()}
    sizes.pop(recording.RECORD_NAME, None)
    return record if sizes == record.file_bytes else None


def _build(
    folder: Path, cache_key: _CacheKey, sources: tuple[TopicSource, ...], progress: Progress | None
) -> recording.DatasetRecord:
    """Write bag and record into a new folder."""
    sequence, scene = catalogue.find_sequence(cache_key.dataset), find_scene(cache_key.dataset)
    times_ns = {source: catalogue.message_times_ns(source, cache_key.window) for source in sources}
    schedule = sorted(
        ((time_ns, source) for source, times in times_ns.items() for time_ns in times),
        key=lambda entry: (entry[0], entry[1].name),
    )
    types = {source.name: source.type for source in sources}
    content = ContentHash(types, sequence.start_ns)

    def render(entry: tuple[int, TopicSource]) -> recording.RecordedMessage:
        time_ns, source = entry
        data = render_message(scene, source, sequence.start_ns, time_ns)
        return recording.RecordedMessage(
            topic=source.name, time_ns=sequence.start_ns + time_ns, data=data
        )

    def hashed(
        messages: Iterable[recording.RecordedMessage],
    ) -> Iterator[recording.RecordedMessage]:
        for number, message in enumerate(messages, start=1):
            content.add(message)
            yield message
            if progress is not None:
                progress(number, len(schedule))

    # Always closed, so that no thread continues to render after the folder is removed.
    with closing(_map_in_order(render, schedule)) as messages:
        write_bag(folder, types, hashed(messages), cache_key.storage)
    record = recording.DatasetRecord(
        generator=GENERATOR_VERSION,
        dataset=cache_key.dataset,
        window=cache_key.window,
        storage=cache_key.storage,
        start_ns=sequence.start_ns,
        topics={
            source.name: recording.TopicRecord(
                type=source.type,
                count=len(times_ns[source]),
                rate_hz=float(source.rate_hz),
                max_message_bytes=source.message_bytes,
            )
            for source in sources
        },
        content_sha256=content.hexdigest(),
        file_bytes={path.name: path.stat().st_size for path in sorted(folder.iterdir())},
    )
    recording.write_provenance(folder, record)
    return record


def _map_in_order(
    function: Callable[[_Task], _Result], tasks: Iterable[_Task]
) -> Generator[_Result]:
    """Apply a function in a few threads, yielding results in the tasks' order.

    The results are written in order, so the output does not depend on the number of threads. At
    most two tasks per thread are in progress or wait to be consumed.
    """
    workers = min(_MAX_WORKERS, len(os.sched_getaffinity(0)))
    waiting: deque[Future[_Result]] = deque()
    pool = ThreadPoolExecutor(workers, thread_name_prefix="r2bspec-render")
    try:
        for task in tasks:
            waiting.append(pool.submit(function, task))
            if len(waiting) >= 2 * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
