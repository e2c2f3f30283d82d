"""How fast, and in how much memory, a large recording is hashed, indexed, read and buffered.

    python benchmarks/bench_data.py [--gib 3] [--repeats 2] [--folder /tmp]

Makes recordings of 1920x1200 rgb8 images in a temporary folder and measures each step in a process
of its own, for its peak memory: beside `sha256sum`, beside reading the bare bytes, and beside
rosbags' `AnyReader` over the same messages. Repetitions are interleaved, each figure is the median.
Before a step that is called cold, the files are dropped from the page cache. Prints Markdown;
asserts nothing but that all readers deliver the same bytes.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from measuring import machine, options, show, table, tell

WIDTH, HEIGHT = 1920, 1200
IMAGE = "sensor_msgs/msg/Image"
TOPIC = "/camera"
PERIOD_NS = 33_333_333
START_NS = 1_700_000_000_000_000_000
BLOCK_BYTES = 1 << 20
MB = 1e6

# Storage plugin and compression mode of the writer.
FORMATS = {
    "sqlite3": ("SQLITE3", "NONE"),
    "sqlite3, zstd by message": ("SQLITE3", "MESSAGE"),
    "MCAP": ("MCAP", "NONE"),
}


# The steps. Each returns the bytes that it delivered.


def raw_read(bag: Path) -> int:
    """The bare bytes of the files."""
    total = 0
    buffer = bytearray(BLOCK_BYTES)
    for file in files(bag):
        with file.open("rb", buffering=0) as stream:
            while length := stream.readinto(buffer):
                total += length
    return total


def sha256sum(bag: Path) -> int:
    """The digests of coreutils."""
    subprocess.run(["sha256sum", *files(bag)], check=True, capture_output=True)  # noqa: S607
    return size(bag)


def hash_of_r2bspec(bag: Path) -> int:
    from r2bspec.bags.integrity import hash_files

    hash_files(bag)
    return size(bag)


def index(bag: Path) -> int:
    from r2bspec.bags.bag_index import index_bag

    index_bag(bag)
    return 0


def any_reader(bag: Path) -> int:
    return sum(map(len, _of_any_reader(bag)))


def reader(bag: Path) -> int:
    return sum(map(len, _of_r2bspec(bag)))


def any_reader_window(bag: Path) -> int:
    return sum(map(len, _of_any_reader(bag, *_window(bag))))


def reader_window(bag: Path) -> int:
    return sum(map(len, _of_r2bspec(bag, *_window(bag))))


def any_reader_to_file(bag: Path) -> int:
    """What the loader does at least: every message to a file."""
    total = 0
    with (_out(bag) / "plain").open("wb") as stream:
        for data in _of_any_reader(bag):
            total += stream.write(data)
    return total


def buffers(bag: Path) -> int:
    """The loader of r2bspec: messages to a buffer, with the index that the player needs."""
    from r2bspec.execute.fill_buffers import buffer_bags
    from r2bspec.execute.progress import Progress
    from r2bspec.plan.plan import BagTopicPlan, DatasetPlan

    topic = BagTopicPlan(bag_topic=TOPIC, topic="/buffered", type=IMAGE, count=0, rate_hz=0.0)
    plan = DatasetPlan(
        source=str(bag), kind="recorded", sha256="", start_ns=0, end_ns=None, topics=(topic,)
    )
    buffer_bags([bag], [plan], _out(bag), Progress())
    return sum(each.stat().st_size for each in _out(bag).glob("*.cdr"))


STEPS: dict[str, tuple[Callable[[Path], int], bool]] = {
    "read the bare bytes": (raw_read, True),
    "sha256sum": (sha256sum, False),
    "hash": (hash_of_r2bspec, True),
    "index": (index, True),
    "AnyReader: all messages": (any_reader, False),
    "r2bspec: all messages": (reader, False),
    "AnyReader: a tenth, from the middle": (any_reader_window, False),
    "r2bspec: a tenth, from the middle": (reader_window, False),
    "AnyReader: all messages to a file": (any_reader_to_file, False),
    "r2bspec: all messages to a buffer": (buffers, False),
}
"""By name: what to do, and whether it is measured cold, too."""


def _of_any_reader(
    bag: Path, start_ns: int | None = None, stop_ns: int | None = None
) -> Iterator[bytes]:
    from rosbags.highlevel import AnyReader

    with AnyReader([bag]) as opened:
        for _, _, data in opened.messages(start=start_ns, stop=stop_ns):
            yield data


def _of_r2bspec(
    bag: Path, start_ns: int | None = None, stop_ns: int | None = None
) -> Iterator[bytes]:
    from r2bspec.bags.bag_reader import read_messages
    from r2bspec.bags.recording import TimeWindow

    window = None
    if start_ns is not None and stop_ns is not None:
        window = TimeWindow(start_ns=start_ns - START_NS, end_ns=stop_ns - START_NS)
    for message in read_messages(bag, [TOPIC], window):
        yield message.data


def _window(bag: Path) -> tuple[int, int]:
    length_ns = int((bag.parent / "count").read_text()) * PERIOD_NS
    return START_NS + length_ns // 2, START_NS + length_ns * 6 // 10


def _out(bag: Path) -> Path:
    folder = bag.parent / "out"
    folder.mkdir(exist_ok=True)
    return folder


def files(bag: Path) -> list[Path]:
    return sorted(bag.iterdir())


def size(bag: Path) -> int:
    return sum(each.stat().st_size for each in files(bag))


# One step in a process of its own


def measure(step: str, bag: Path, *, cold: bool) -> dict[str, float]:
    """Run a step in a fresh process; seconds of the step itself, and what it delivered."""
    for file in _out(bag).iterdir():
        file.unlink()
    if cold:
        for file in files(bag):
            descriptor = os.open(file, os.O_RDONLY)
            os.fsync(descriptor)
            os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
            os.close(descriptor)
    else:
        raw_read(bag)
    command = [sys.executable, __file__, "--child", step, str(bag)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def child(step: str, bag: Path) -> None:
    """What the process does."""
    # Imports are paid once by a run, and are no matter of the bag's size.

    import r2bspec.bags.bag_reader
    import r2bspec.execute.fill_buffers  # noqa: F401

    action, _ = STEPS[step]
    begin = time.perf_counter()
    delivered = action(bag)
    seconds = time.perf_counter() - begin
    show(json.dumps({"seconds": seconds, "delivered": delivered, "peak_mb": _peak_mb()}))


def _peak_mb() -> float:
    # Not from getrusage, which counts the process that forked this one, too.
    status = Path("/proc/self/status").read_text()
    return float(status.partition("VmHWM:")[2].split()[0]) * 1024 / MB


# The table


def make(folder: Path, plugin: str, mode: str, gib: float) -> Path:
    """Write a recording of that many uncompressed gibibytes; like a camera's, half compressible."""
    import numpy as np
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    pixels = np.random.default_rng(1).integers(0, 16, WIDTH * HEIGHT * 3, dtype=np.uint8)
    count = max(20, round(gib * 2**30 / pixels.size))
    folder.mkdir()
    (folder / "count").write_text(str(count))
    writer = Writer(folder / "bag", version=8, storage_plugin=StoragePlugin[plugin])
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(TOPIC, IMAGE, typestore=store)
        for number in range(count):
            time_ns = START_NS + number * PERIOD_NS
            stamp = types["builtin_interfaces/msg/Time"](*divmod(time_ns, 10**9))
            header = types["std_msgs/msg/Header"](stamp, "camera")
            image = types[IMAGE](header, HEIGHT, WIDTH, "rgb8", 0, WIDTH * 3, pixels)
            writer.write(connection, time_ns, store.serialize_cdr(image, IMAGE))
    return folder / "bag"


def main() -> int:
    parser = options(__doc__)
    parser.add_argument("--gib", type=float, default=3.0, help="size of each recording")
    parser.add_argument("--repeats", type=int, default=2, help="runs of each step")
    parser.add_argument("--folder", default=None, help="where the recordings are made")
    parser.add_argument("--child", nargs=2, help="measure one step of one recording")
    given = parser.parse_args()
    if given.child:
        child(given.child[0], Path(given.child[1]))
        return 0
    load = f"load average {os.getloadavg()[0]:.1f} at the start"
    show(
        f"{machine()}; {given.gib:g} GiB of images, medians of {given.repeats}; {load}.",
        "",
        *table(("recording", "step", "cold", "cached", "peak memory"), _rows(given)),
    )
    return 0


def _rows(given: argparse.Namespace) -> Iterator[list[str]]:
    with tempfile.TemporaryDirectory(prefix="bench-data-", dir=given.folder) as scratch:
        for number, (name, (plugin, mode)) in enumerate(FORMATS.items()):
            tell(f"making {name}")
            bag = make(Path(scratch) / f"{number}", plugin, mode, given.gib)
            yield from _recording_rows(f"{name}, {size(bag) / MB:,.0f} MB", bag, given.repeats)
            for file in (*files(bag), *_out(bag).iterdir()):
                file.unlink()


def _recording_rows(name: str, bag: Path, repeats: int) -> Iterator[list[str]]:
    found: dict[tuple[str, bool], list[dict[str, float]]] = {}
    for repeat in range(repeats):
        for step, (_, also_cold) in STEPS.items():
            for cold in (True, False) if also_cold else (False,):
                tell(f"{name}, {repeat + 1}/{repeats}: {step}{', cold' if cold else ''}")
                found.setdefault((step, cold), []).append(measure(step, bag, cold=cold))
    _same_bytes(found)
    for step in STEPS:
        cached = found[step, False]
        peak_mb = max(each["peak_mb"] for each in cached)
        memory = "" if step == "sha256sum" else f"{peak_mb:,.0f} MB"
        yield [name, step, _speed(found.get((step, True), ())), _speed(cached), memory]


def _speed(runs: Iterable[dict[str, float]]) -> str:
    several = list(runs)
    if not several:
        return ""
    seconds = statistics.median(each["seconds"] for each in several)
    delivered = several[0]["delivered"]
    if not delivered:
        return f"{seconds * 1e3:,.0f} ms"
    return f"{delivered / MB / seconds:,.0f} MB/s"


def _same_bytes(found: dict[tuple[str, bool], list[dict[str, float]]]) -> None:
    """What both sides deliver is the same."""
    by_work: dict[str, set[float]] = {}
    for (step, _), several in found.items():
        side, colon, work = step.partition(": ")
        if colon and side in {"AnyReader", "r2bspec"}:
            by_work.setdefault(work[:10], set()).update(each["delivered"] for each in several)
    assert all(len(each) == 1 for each in by_work.values()), by_work


if __name__ == "__main__":
    sys.exit(main())
