"""How long a run takes beyond the playing that was asked for, and where that time goes.

    python benchmarks/overhead.py [--runs 3] [--against TREE]

The work is that of the reference tool's default: a graph that passes 1280x720 images on, a search,
and playing at the rate found and at each of three rates (there five times 5 s and 5 s; here four
times half a second, because the playing is not what is measured). The reference tool needs 129 s
beyond its playing. Each run has two starts; the second one has a row of its own. The search ends at
60 Hz, so that it does not depend on what else the machine does; the reference's goes to 300 Hz.

`--against` names the source tree of another version, such as that of a tag: both make their runs in
turn, so that what else runs on the machine meets both.

Prints a Markdown table of the medians, and the range of the runs. Asserts nothing.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_SPEC = """\
r2bspec: 1
name: overhead
data_loader:
  bag: r2b_storage
  window: {start: 0 s, end: 0.5 s}
  topics: {/d455_1_rgb_image: loaded/image, /d455_1_rgb_camera_info: loaded/camera_info}
preprocessors:
  resize:
    python: r2bspec.nodes.ResizeNode
    parameters: {width: 1280, height: 720}
    remappings:
      image/image_raw: loaded/image
      image/camera_info: loaded/camera_info
      resize/image_raw: buffer/image
      resize/camera_info: buffer/camera_info
playback:
  inputs: {image: {from: buffer/image, format: sensor_msgs/msg/Image}}
graph:
  nodes:
    relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image, output: relayed}}
monitors:
  relayed: {topic: relayed, format: sensor_msgs/msg/Image}
benchmark:
  duration: 500 ms
  iterations: 4
  starts: 2
  rates: [10 Hz, 30 Hz, 60 Hz]
  search: {min: 10 Hz, max: 60 Hz, confirm: 0 s}
  gate: {interference: tolerate}
slos:
  at_its_limit: {at: peak, level: info, require: [received >= 0]}
"""

_REFERENCE_S = 129.0
_HERE = Path(__file__).parents[1]

_NAMES = {
    "before": "the command until the first phase (interpreter, validating, planning)",
    "load": "reading the recording",
    "preprocess": "preprocessors: start, feed, record, end",
    "start": "player and monitor: start, and imports of the nodes' processes",
    "harness_overhead": "what these take alone, measured (the floor)",
    "graph": "the graph: start, and until all is matched",
    "warm_up": "warm-up",
    "search": "the search, apart from its playing",
    "play": "between stretches of playing: drains and writing",
    "after": "ending the processes, metrics, verdict and report",
}
_SUMS = {
    "one": "**beyond all playing, with one start**",
    "searching": "playing of the search",
    "beyond": "**beyond the iterations, with one start**",
    "further": "**the further start**: end of the old processes to the end of its warm-up",
    "cpu": "processor time of a whole run",
}


@dataclass(frozen=True)
class Version:
    """A source tree of r2bspec, and its column in the table."""

    title: str
    tree: Path


def one_run(version: Version, folder: Path) -> dict[str, float]:
    """Make a run; returns seconds by part of `_NAMES` and `_SUMS`."""
    folder.mkdir()
    spec = folder / "spec.r2b.yaml"
    spec.write_text(_SPEC)
    used_before = _used_s()
    began = time.monotonic()
    done = subprocess.run(
        [
            *(sys.executable, "-P", "-m", "r2bspec", "run", str(spec)),
            *("--no-lock", "--quiet", "--output", str(folder / "run")),
        ],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(version.tree)},
    )
    ended = time.monotonic()
    used_s = _used_s() - used_before
    if not (folder / "run" / "record.json").is_file():
        raise SystemExit(done.stderr)
    # Read as JSON: the record may be that of another version.
    record = json.loads((folder / "run" / "record.json").read_text())
    if record["status"] != "complete":
        raise SystemExit(done.stderr)
    return split(record, began, ended) | {"cpu": used_s}


def _used_s() -> float:
    """The processor time of all children that have ended, and of theirs."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def split(record: dict[str, Any], began_s: float, ended_s: float) -> dict[str, float]:
    """Seconds by part, the second start apart."""
    later = record["starts"][1]
    further = later["began_ns"] / 1e9, later["ready_ns"] / 1e9
    phases = [
        (at_ns / 1e9, text.removeprefix("phase "))
        for at_ns, text in record["events"]
        if text.startswith("phase ")
    ]
    spent: defaultdict[str, float] = defaultdict(float)
    spent["before"] = phases[0][0] - began_s
    ends = [*(at_s for at_s, _ in phases[1:]), ended_s]
    for (at_s, name), end_s in zip(phases, ends, strict=True):
        # What lies in the second start is no part of the first one.
        within = max(0.0, min(end_s, further[1]) - max(at_s, further[0]))
        spent["after" if name == "collect" else name] += end_s - at_s - within
    played: defaultdict[str, float] = defaultdict(float)
    for each in record["segments"]:
        played[each["kind"]] += (each["ended_ns"] - each["began_ns"]) / 1e9
    spent["play"] -= played["iteration"]
    spent["search"] -= played["probe"]
    one = sum(spent.values())
    return spent | {
        "one": one,
        "searching": played["probe"],
        "beyond": one + played["probe"],
        "further": further[1] - further[0],
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--against", type=Path, metavar="TREE")
    asked = parser.parse_args()
    versions = [Version("this version", _HERE)]
    if asked.against is not None:
        versions.insert(0, Version(f"`{asked.against.name}`", asked.against.absolute()))
    found: dict[str, list[dict[str, float]]] = {each.title: [] for each in versions}
    with tempfile.TemporaryDirectory(prefix="overhead-") as scratch:
        for number in range(asked.runs):
            for column, version in enumerate(versions):
                spent = one_run(version, Path(scratch) / f"{number}-{column}")
                found[version.title].append(spent)
                sys.stderr.write(f"{version.title}: {spent['beyond']:.1f} s\n")
    titles = [each.title for each in versions]
    lines = [f"| part | {' | '.join(titles)} |", f"| --- {'| --- ' * len(titles)}|"]
    for key, text in (_NAMES | _SUMS).items():
        cells = [_cell([each.get(key, 0.0) for each in found[title]]) for title in titles]
        lines.append(f"| {text} | {' | '.join(cells)} |")
    reference = f" {_REFERENCE_S:g} s |" * len(titles)
    lines.append(f"| the reference tool, beyond its iterations |{reference}")
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stdout.write(f"\n{asked.runs} runs; load average {os.getloadavg()[1]:.1f}; ")
    sys.stdout.write(f"{os.cpu_count()} cores\n")


def _cell(seconds: list[float]) -> str:
    return f"{statistics.median(seconds):.2f} s ({min(seconds):.2f} to {max(seconds):.2f})"


if __name__ == "__main__":
    main()
