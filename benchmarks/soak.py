"""Whether a long run holds its memory: half an hour at 100 Hz, watched from outside.

    python benchmarks/soak.py [--minutes 30] [--rate 100]

Plays camera infos through a RelayNode in one iteration, samples memory and descriptors of the
controller and of every process of the run, and prints a Markdown table: the median of the second
tenth of the time against that of the last one, and the slope of a straight line through all after
the first tenth, in which buffers and histories fill up. Asserts nothing.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import psutil

_SPEC = """\
r2bspec: 1
name: soak
data_loader:
  bag: r2b_storage
  window: {{start: 0.0 s, end: 1.0 s}}
  topics: {{/d455_1_rgb_camera_info: recorded/camera_info}}
playback:
  inputs:
    camera_info: {{from: recorded/camera_info, format: sensor_msgs/msg/CameraInfo}}
graph:
  nodes:
    relay:
      python: r2bspec.nodes.RelayNode
      parameters: {{format: sensor_msgs/msg/CameraInfo, service_time_ms: 1.0}}
      remappings: {{input: camera_info, output: relayed}}
monitors:
  relayed: {{topic: relayed, format: sensor_msgs/msg/CameraInfo}}
benchmark: {{duration: {seconds} s, iterations: 1, rates: [{rate:g} Hz]}}
slos:
  flat:
    at: {rate:g} Hz
    require: [drop_rate <= 1 %]
"""
_PERIOD_S = 2.0


class Sample(NamedTuple):
    """One process at one time."""

    at_s: float
    memory_bytes: int
    descriptors: int


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=30.0, help="how long to play")
    parser.add_argument("--rate", type=float, default=100.0, help="messages per second")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        spec, output = Path(folder, "soak.r2b.yaml"), Path(folder, "run")
        spec.write_text(_SPEC.format(seconds=round(options.minutes * 60), rate=options.rate))
        command = [sys.executable, "-m", "r2bspec", "run", str(spec), "--output", str(output)]
        with Path(folder, "log").open("w+b") as log:
            run = subprocess.Popen(command, stdout=log, stderr=log)
            samples = _watch(psutil.Process(run.pid))
            status = run.wait()
            log.seek(0)
            sys.stderr.write(log.read().decode())
        if status not in {0, 1, 4} or not (output / "result.json").exists():
            return 1
        record = json.loads((output / "record.json").read_text())
        _print(record, samples, run.pid, options)
    return 0


def _watch(controller: psutil.Process) -> dict[int, list[Sample]]:
    """Sample until the controller has ended."""
    samples: dict[int, list[Sample]] = defaultdict(list)
    while controller.is_running() and controller.status() != psutil.STATUS_ZOMBIE:
        try:
            for each in (controller, *controller.children(recursive=True)):
                with each.oneshot():
                    now = Sample(time.monotonic(), each.memory_info().rss, each.num_fds())
                samples[each.pid].append(now)
        except psutil.Error:
            continue
        finally:
            time.sleep(_PERIOD_S)
    return samples


def _print(
    record: dict[str, object],
    samples: dict[int, list[Sample]],
    controller: int,
    options: argparse.Namespace,
) -> None:
    names = {controller: "controller"}
    processes = record["processes"]
    assert isinstance(processes, list)
    names |= {each["pid"]: each["name"] for each in processes}
    segments = record["segments"]
    assert isinstance(segments, list)
    played = next(each for each in segments if each["kind"] == "iteration")
    began_s, ended_s = played["began_ns"] / 1e9, played["ended_ns"] / 1e9
    tenth_s = (ended_s - began_s) / 10
    out = sys.stdout
    out.write(
        f"{options.minutes:g} minutes at {options.rate:g} Hz, {played['steps']} messages.\n\n"
    )
    out.write("| process | second tenth | last tenth | slope | descriptors then, at the end |\n")
    out.write("| --- | --- | --- | --- | --- |\n")
    for pid, name in names.items():
        kept = [each for each in samples[pid] if began_s + tenth_s <= each.at_s <= ended_s]
        if len(kept) < 3:
            continue
        early = [each for each in kept if each.at_s < began_s + 2 * tenth_s]
        late = [each for each in kept if each.at_s > ended_s - tenth_s]
        slope = statistics.linear_regression(
            [each.at_s / 3600 for each in kept], [each.memory_bytes / 2**20 for each in kept]
        ).slope
        out.write(
            f"| {name} | {_mib(early)} | {_mib(late)} | {slope:+.2f} MiB/h "
            f"| {early[0].descriptors}, {late[-1].descriptors} |\n"
        )


def _mib(samples: list[Sample]) -> str:
    return f"{statistics.median(each.memory_bytes for each in samples) / 2**20:.1f} MiB"


if __name__ == "__main__":
    sys.exit(main())
