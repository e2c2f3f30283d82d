"""What the way to a graph and back costs, by the placement of the harness.

    PYTHONPATH=tests/support python benchmarks/placement_latency.py [--repetitions 3] [--seconds 5]

A relay in C that publishes what it receives gets images of 1280x720 rgb8 at 60 Hz:
with player and monitor in processes of their own, in one, and in the process of the relay. All are
run again with an allocator that keeps the memory of messages, as a graph could set it for itself.
The repetitions are interleaved, so that a disturbance of the machine touches all rows alike; each
figure is the median of them.

Prints a Markdown table. The ratio is that of the p50 to the one of separate processes with the same
allocator; what this project wants is at most 0.4. Asserts nothing.
"""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from measuring import options, run, show, table, tell
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from c_nodes import c_node_spec
from r2bspec.judge.judge_run import result_of

_KEEPS_MEMORY = {
    "MALLOC_MMAP_MAX_": "0",
    "MALLOC_TRIM_THRESHOLD_": str(1 << 30),
    "MALLOC_TOP_PAD_": str(64 << 20),
}
_ROWS = [
    (placement, allocator)
    for allocator in ("default", "keeps memory")
    for placement in ("separate", "shared", "graph")
]
_WIDTH, _HEIGHT, _RATE_HZ = 1280, 720, 60
_IMAGE = "sensor_msgs/msg/Image"
_FRAMES = 8


class Figures(NamedTuple):
    """What a run has shown: latencies and CPU time per message of all processes, in ms."""

    p50: float
    p99: float
    cpu: float


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=5.0)
    given = parser.parse_args()
    found: dict[tuple[str, str], list[Figures]] = {row: [] for row in _ROWS}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        _write_bag(folder / "bag")
        for number in range(given.repetitions):
            for row in _ROWS:
                tell(f"repetition {number + 1}: {', '.join(row)}")
                found[row].append(_measure(folder, f"{number}-{'-'.join(row)}", row, given.seconds))
    head = ("harness", "allocator of the relay", "p50", "p99", "CPU per message", "ratio of p50")
    show(*table(head, _rows(found)))


def _rows(found: dict[tuple[str, str], list[Figures]]) -> Iterator[list[str]]:
    for (placement, allocator), runs in found.items():
        medians = Figures(*map(statistics.median, zip(*runs, strict=True)))
        base = statistics.median(each.p50 for each in found["separate", allocator])
        cells = [f"{each:.2f} ms" for each in medians]
        yield [placement, allocator, *cells, f"{medians.p50 / base:.2f}"]


def _measure(folder: Path, name: str, row: tuple[str, str], seconds: float) -> Figures:
    placement, allocator = row
    node = c_node_spec("relay", env=_KEEPS_MEMORY if allocator == "keeps memory" else {})
    spec = {
        "r2bspec": 1,
        "name": "placement",
        "data_loader": {"bag": "./bag", "topics": {"/camera": "loaded"}},
        "playback": {"buffer": _FRAMES, "inputs": {"input": {"from": "loaded", "format": _IMAGE}}},
        "harness": {"placement": placement},
        "graph": {"nodes": {"relay": node}},
        "monitors": {"out": {"topic": "output", "format": _IMAGE}},
        "benchmark": {
            "duration": f"{seconds:g} s",
            "iterations": 1,
            "starts": 1,
            "rates": [f"{_RATE_HZ} Hz"],
            "warm_up": "1 s",
            "gate": {"interference": "tolerate"},
        },
    }
    path = folder / f"{name.replace(' ', '-')}.r2b.yaml"
    path.write_text(yaml.safe_dump(spec))
    [rate] = result_of(run(path, folder / name)).metrics.rates
    latency = rate.pooled.monitors["out"].latency
    cores = sum(each.cpu_mean or 0.0 for each in rate.pooled.processes.values())
    assert latency.p50 is not None
    assert latency.p99 is not None
    return Figures(latency.p50 * 1e3, latency.p99 * 1e3, cores / _RATE_HZ * 1e3)


def _write_bag(folder: Path) -> None:
    types = get_typestore(Stores.ROS2_JAZZY)
    pixels = np.zeros(_WIDTH * _HEIGHT * 3, np.uint8)
    with Writer(folder, version=9) as writer:
        connection = writer.add_connection("/camera", _IMAGE, typestore=types)
        for number in range(_FRAMES):
            seconds = 1_700_000_000 + number
            stamp = types.types["builtin_interfaces/msg/Time"](seconds, 0)
            header = types.types["std_msgs/msg/Header"](stamp, "camera")
            image = types.types[_IMAGE](header, _HEIGHT, _WIDTH, "rgb8", 0, _WIDTH * 3, pixels)
            writer.write(connection, seconds * 10**9, types.serialize_cdr(image, _IMAGE))


if __name__ == "__main__":
    main()
