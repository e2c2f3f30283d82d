"""Whether a long run holds its memory: half an hour at 100 Hz, watched from outside.

    python benchmarks/soak.py [--minutes 30] [--rate 100]

Plays camera infos through a RelayNode in one iteration, samples memory and descriptors of the
controller and of every process of the run, and prints a Markdown table: the median of the second
tenth of the time against that of the last one, and the slope of a straight line through all after
the first tenth, in which buffers and histories fill up. Asserts nothing.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import psutil
from measuring import environment, options, run_command, show, table

from r2bspec.record.run_folder import open_run
from r2bspec.record.run_record import RunRecord

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
"""
_PERIOD_S = 2.0


class Sample(NamedTuple):
    """One process at one time."""

    at_s: float
    memory_bytes: int
    descriptors: int


def main() -> int:
    parser = options(__doc__)
    parser.add_argument("--minutes", type=float, default=30.0, help="how long to play")
    parser.add_argument("--rate", type=float, default=100.0, help="messages per second")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        spec, output = Path(folder, "soak.r2b.yaml"), Path(folder, "run")
        spec.write_text(_SPEC.format(seconds=round(given.minutes * 60), rate=given.rate))
        run = subprocess.Popen(run_command(spec, output), env=environment(), stdout=sys.stderr)
        samples = _watch(psutil.Process(run.pid))
        status = run.wait()
        if status not in {0, 1, 4} or not (output / "result.json").exists():
            return 1
        show(f"{given.minutes:g} minutes at {given.rate:g} Hz.", "")
        head = ("process", "second tenth", "last tenth", "slope", "descriptors then, at the end")
        show(*table(head, _rows(open_run(output).record, samples, run.pid)))
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


def _rows(
    record: RunRecord, samples: dict[int, list[Sample]], controller: int
) -> Iterator[list[str]]:
    names = {controller: "controller"} | {each.pid: each.name for each in record.processes}
    played = next(each for each in record.segments if each.kind == "iteration")
    began_s, ended_s = played.began_ns / 1e9, played.ended_ns / 1e9
    tenth_s = (ended_s - began_s) / 10
    for pid, name in names.items():
        kept = [each for each in samples[pid] if began_s + tenth_s <= each.at_s <= ended_s]
        if len(kept) < 3:
            continue
        early = [each for each in kept if each.at_s < began_s + 2 * tenth_s]
        late = [each for each in kept if each.at_s > ended_s - tenth_s]
        slope = statistics.linear_regression(
            [each.at_s / 3600 for each in kept], [each.memory_bytes / 2**20 for each in kept]
        ).slope
        descriptors = f"{early[0].descriptors}, {late[-1].descriptors}"
        yield [name, _mib(early), _mib(late), f"{slope:+.2f} MiB/h", descriptors]


def _mib(samples: list[Sample]) -> str:
    return f"{statistics.median(each.memory_bytes for each in samples) / 2**20:.1f} MiB"


if __name__ == "__main__":
    sys.exit(main())
