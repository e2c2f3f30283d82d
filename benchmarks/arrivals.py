"""How late steps begin with each kind of arrivals, and whether Poisson arrivals are such.

    python benchmarks/arrivals.py [--seconds 20]

Plays camera_info to a relay at 100 Hz. Late is a publication after its due time, over all
iterations; `p` is that of a Kolmogorov-Smirnov test of the intervals between the times of
publication for an exponential distribution with the offered rate. Prints Markdown.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from measuring import machine, options, show, table, tell
from scipy.stats import kstest

from r2bspec.record.run_folder import open_run

_RATE_HZ = 100.0
_KINDS = {
    "fixed": "fixed",
    "poisson": "poisson",
    "bursts of 5": "{kind: bursts, size: 5}",
    "jitter 50 %": "{kind: jitter, share: 50 %}",
    "dropout 10 %": "{kind: dropout, share: 10 %}",
}
_SPEC = """
r2bspec: 1
name: arrivals
data_loader: {{bag: r2b_storage, topics: {{/d455_1_rgb_camera_info: recorded}}}}
playback:
  arrivals: {arrivals}
  inputs: {{input: {{from: recorded, format: sensor_msgs/msg/CameraInfo}}}}
graph:
  nodes:
    relay: {{python: r2bspec.nodes.RelayNode, parameters: {{format: sensor_msgs/msg/CameraInfo}}}}
monitors: {{output: {{topic: output, format: sensor_msgs/msg/CameraInfo}}}}
benchmark: {{duration: {seconds} s, iterations: 3, starts: 1, rates: [100 Hz]}}
"""


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--seconds", type=int, default=20)
    given = parser.parse_args()
    rows = [[name, *_figures(kind, given.seconds)] for name, kind in _KINDS.items()]
    show(f"{machine()}.", "")
    show(*table(("arrivals", "late p50", "late p99", "p of Poisson"), rows))


def _figures(arrivals: str, seconds: int) -> tuple[str, str, str]:
    with tempfile.TemporaryDirectory() as folder:
        spec = Path(folder, "arrivals.r2b.yaml")
        spec.write_text(_SPEC.format(arrivals=arrivals, seconds=seconds), encoding="utf-8")
        command = [sys.executable, "-m", "r2bspec", "run", str(spec), "-o", f"{folder}/run"]
        subprocess.run(command, check=False, capture_output=True)
        tell(arrivals)
        run = open_run(Path(folder, "run"))
        played = [
            run.playback(segment) for segment in run.record.segments if segment.kind == "iteration"
        ]
        late_ms = np.concatenate([rows["published_ns"] - rows["due_ns"] for rows in played]) / 1e6
        intervals_s = np.concatenate([np.diff(rows["published_ns"]) for rows in played]) / 1e9
    p = kstest(intervals_s * _RATE_HZ, "expon").pvalue
    p50, p99 = (f"{value:.3f} ms" for value in np.quantile(late_ms, (0.5, 0.99)))
    return p50, p99, f"{p:.2g}"


if __name__ == "__main__":
    main()
