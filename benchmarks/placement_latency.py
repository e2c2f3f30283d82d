"""What the way to a graph and back costs, by the placement of the harness.

    python benchmarks/placement_latency.py [--repetitions 3] [--seconds 5]

A relay in C that publishes what it receives gets images of 1280x720 rgb8 at 60 Hz:
with player and monitor in processes of their own, in one, and in the process of the relay. All are
run again with an allocator that keeps the memory of messages, as a graph could set it for itself.
The repetitions are interleaved, so that a disturbance of the machine touches all rows alike; each
figure is the median of them.

Prints a Markdown table. The ratio is that of the p50 to the one of separate processes with the same
allocator; what this project wants is at most 0.4. A placement that cannot be run is named with the
reason. Asserts nothing.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from c_nodes import c_node_spec

PLACEMENTS = ("separate", "shared", "graph")
KEEPS_MEMORY = {
    "MALLOC_MMAP_MAX_": "0",
    "MALLOC_TRIM_THRESHOLD_": str(1 << 30),
    "MALLOC_TOP_PAD_": str(64 << 20),
}
WIDTH, HEIGHT, RATE_HZ = 1280, 720, 60
_IMAGE = "sensor_msgs/msg/Image"
_FRAMES = 8


@dataclass(frozen=True)
class Figures:
    """What a run has shown: latencies and CPU time per message of all processes, in ms."""

    p50: float
    p99: float
    cpu: float


def main() -> None:
    """Run all placements, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=5.0)
    options = parser.parse_args()
    rows = [(place, keeps) for keeps in (False, True) for place in PLACEMENTS]
    found: dict[tuple[str, bool], list[Figures]] = {row: [] for row in rows}
    failed: dict[tuple[str, bool], str] = {}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        _write_bag(folder / "bag")
        for number in range(options.repetitions):
            for row in rows:
                sys.stderr.write(f"repetition {number + 1}: {row[0]}\n")
                name = f"{row[0]}-{row[1]}-{number}"
                figures = _run(folder, name, _spec(*row, options.seconds))
                if isinstance(figures, str):
                    failed[row] = figures
                else:
                    found[row].append(figures)
    for line in _table(found, failed):
        sys.stdout.write(f"{line}\n")


def _table(
    found: dict[tuple[str, bool], list[Figures]], failed: dict[tuple[str, bool], str]
) -> Iterator[str]:
    yield "| harness | allocator of the relay | p50 | p99 | CPU per message | ratio of p50 |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for (placement, keeps), runs in found.items():
        allocator = "keeps memory" if keeps else "default"
        if not runs:
            yield f"| {placement} | {allocator} | – | – | – | {failed[placement, keeps]} |"
            continue
        p50, p99, cpu = (
            statistics.median(getattr(each, name) for each in runs)
            for name in ("p50", "p99", "cpu")
        )
        base = found["separate", keeps]
        ratio = f"{p50 / statistics.median(each.p50 for each in base):.2f}" if base else "–"
        figures = " | ".join(f"{each:.2f} ms" for each in (p50, p99, cpu))
        yield f"| {placement} | {allocator} | {figures} | {ratio} |"


def _spec(placement: str, keeps_memory: bool, seconds: float) -> dict[str, Any]:
    node = c_node_spec("relay", env=KEEPS_MEMORY if keeps_memory else {})
    return {
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
            "rates": [f"{RATE_HZ} Hz"],
            "warm_up": "1 s",
            "gate": {"interference": "tolerate"},
        },
    }


def _run(folder: Path, name: str, spec: dict[str, Any]) -> Figures | str:
    """The figures of a run, or why it failed."""
    path = folder / f"{name}.r2b.yaml"
    path.write_text(yaml.safe_dump(spec))
    output = folder / name
    done = subprocess.run(
        [sys.executable, "-m", "r2bspec", "run", str(path), "--quiet", "--output", str(output)],
        capture_output=True,
        text=True,
        check=False,
    )
    result = output / "result.json"
    rates = json.loads(result.read_text())["metrics"]["rates"] if result.exists() else []
    if not rates:
        lines = [each for each in done.stderr.splitlines() if each.startswith("error")]
        return lines[0] if lines else f"exit status {done.returncode}"
    pooled = rates[0]["pooled"]
    latency = pooled["monitors"]["out"]["latency"]
    cores = sum(each["cpu_mean"] for each in pooled["processes"].values())
    return Figures(latency["p50"] * 1e3, latency["p99"] * 1e3, cores / RATE_HZ * 1e3)


def _write_bag(folder: Path) -> None:
    types = get_typestore(Stores.ROS2_JAZZY)
    pixels = np.zeros(WIDTH * HEIGHT * 3, np.uint8)
    with Writer(folder, version=9) as writer:
        connection = writer.add_connection("/camera", _IMAGE, typestore=types)
        for number in range(_FRAMES):
            seconds = 1_700_000_000 + number
            stamp = types.types["builtin_interfaces/msg/Time"](seconds, 0)
            header = types.types["std_msgs/msg/Header"](stamp, "camera")
            image = types.types[_IMAGE](header, HEIGHT, WIDTH, "rgb8", 0, WIDTH * 3, pixels)
            data = types.serialize_cdr(image, _IMAGE)
            writer.write(connection, seconds * 10**9, data)


if __name__ == "__main__":
    main()
