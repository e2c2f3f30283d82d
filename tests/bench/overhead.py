"""How long a run takes beyond the playing that was asked for, and where that time goes.

    python tests/bench/overhead.py [--runs 3]

The work is that of the reference tool's default: a graph that passes 1280x720 images on, a search
from 10 to 300 Hz, and 40 s of playing (here twice 5 s at the rate found and at each of three rates;
there five times 5 s at the rate found and 5 s at each of three), which it needs 169 s for, 129 s of
them overhead. The time from the start of the command to its end is split by the events and segments
of the record.

Prints a Markdown table of the medians and the range of the runs. Asserts nothing.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

from r2bspec.record.run_folder import open_run
from r2bspec.report.report_wording import peak_text

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
  duration: 5 s
  iterations: 2
  rates: [10 Hz, 30 Hz, 60 Hz]
  search: {min: 10 Hz, max: 300 Hz}
slos:
  at_its_limit: {at: peak, level: info, require: [received >= 0]}
"""

_ASKED_S = 40.0
_REFERENCE_S = 169.0

_NAMES = {
    "before": "the command until the first phase (interpreter, validating, planning)",
    "load": "reading the recording",
    "preprocess": "preprocessors: start, feed, record, end",
    "start": "player and monitor: start",
    "floor": "what these take alone, measured (the floor)",
    "graph": "the graph: start, and until all is matched",
    "warm_up": "warm-up",
    "search": "the search",
    "asked": "playing that was asked for",
    "between": "between stretches of playing: drains and writing",
    "after": "ending the processes, metrics, verdict and report",
}


def one_run(folder: Path) -> tuple[dict[str, float], str]:
    """Run the tool; returns seconds by part of `_NAMES`, and the peak in words."""
    folder.mkdir()
    spec = folder / "spec.r2b.yaml"
    spec.write_text(_SPEC)
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "r2bspec", "run", str(spec), "--output", str(folder / "run")],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
    )
    ended = time.monotonic()
    if not (folder / "run" / "record.json").is_file():
        raise SystemExit(done.stderr)
    record = open_run(folder / "run").record
    if record.status != "complete":
        raise SystemExit(done.stderr)
    phases = [
        (at_ns / 1e9, text.removeprefix("phase "))
        for at_ns, text in record.events
        if text.startswith("phase ")
    ]
    spent: defaultdict[str, float] = defaultdict(float)
    spent["before"] = phases[0][0] - began
    ends = [at_s for at_s, _ in phases[1:]]
    for (at_s, name), end_s in zip(phases, ends, strict=False):
        spent[name] += end_s - at_s
    played = [each for each in record.segments if each.kind == "iteration"]
    spent["asked"] = sum(each.steps / each.rate_hz for each in played)
    spent["between"] = spent.pop("play") - spent["asked"]
    # Processes are ended after the last phase has begun, and then the record is made.
    spent["after"] = ended - phases[-1][0]
    spent.pop("collect", None)
    return dict(spent), peak_text(record.search) if record.search else ""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=3)
    asked = parser.parse_args()
    found: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory(prefix="overhead-") as scratch:
        for number in range(asked.runs):
            spent, peak = one_run(Path(scratch) / str(number))
            found.append(spent)
            sys.stderr.write(f"{sum(spent.values()):.1f} s, peak {peak}\n")
    lines = ["| part | median | range |", "| --- | --- | --- |"]
    lines += [_line(text, [each.get(key, 0.0) for each in found]) for key, text in _NAMES.items()]
    whole = [sum(each.values()) for each in found]
    lines.append(_line("**in all**", whole))
    beyond = [sum(each.values()) - each["asked"] for each in found]
    lines.append(_line("**beyond the playing that was asked for**", beyond))
    lines.append(f"| the reference tool, beyond its 40 s | {_REFERENCE_S - _ASKED_S:g} s | |")
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stdout.write(f"\n{asked.runs} runs; load average {os.getloadavg()[1]:.1f}; ")
    sys.stdout.write(f"{os.cpu_count()} cores\n")


def _line(text: str, seconds: list[float]) -> str:
    return (
        f"| {text} | {statistics.median(seconds):.1f} s "
        f"| {min(seconds):.1f} to {max(seconds):.1f} s |"
    )


if __name__ == "__main__":
    main()
