"""What all benchmarks do: start runs, name the machine, print tables in Markdown."""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from r2bspec.record.run_folder import Run, open_run

ROOT = Path(__file__).parents[1]


def options(doc: str | None) -> argparse.ArgumentParser:
    """A parser that shows the docstring of a program."""
    return argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def tell(text: str) -> None:
    """Say how far the program is."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201 - a program


def show(*lines: str) -> None:
    """Print a part of the result."""
    print("\n".join(lines), flush=True)  # noqa: T201 - a program


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """The lines of a table."""
    yield f"| {' | '.join(head)} |"
    yield "| --- " * len(head) + "|"
    for row in rows:
        yield f"| {' | '.join(row)} |"


def machine() -> str:
    """What the figures are true of."""
    return (
        f"{len(os.sched_getaffinity(0))} cores, {platform.machine()}, Linux {platform.release()}, "
        f"Python {platform.python_version()}"
    )


def chain_spec(nodes: int) -> str:
    """A spec of ten lines for each node: nodes in a chain, with comments and parameters."""
    lines = [
        "r2bspec: 1",
        "name: chain",
        "data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: recorded/image}}",
        "playback:",
        "  inputs: {link_0: {from: recorded/image, format: sensor_msgs/msg/Image}}",
        "benchmark: {rates: [30 Hz], duration: 10 s}",
        f"monitors: {{end: {{topic: link_{nodes}, format: sensor_msgs/msg/Image}}}}",
        "slos: {fast: {at: 30 Hz, require: [latency.p90 < 250 ms, drop_rate <= 5 %]}}",
        "graph:",
        "  nodes:",
    ]
    for number in range(nodes):
        lines += [
            f"    # stage {number}: takes what the stage before it has made",
            f"    relay_{number}:",
            "      python: r2bspec.nodes.RelayNode",
            "      parameters:",
            "        service_time_ms: 0.5",
            "      env:",
            '        OMP_NUM_THREADS: "1"',
            "      remappings:",
            f"        input: link_{number}",
            f"        output: link_{number + 1}",
        ]
    return "\n".join(lines) + "\n"


def run_command(spec: Path, output: Path, *arguments: str) -> list[str]:
    """The command line of a run of this source tree."""
    command = [sys.executable, "-m", "r2bspec", "run", str(spec), "--quiet"]
    return [*command, "--output", str(output), *arguments]


def environment(**changes: str) -> Mapping[str, str]:
    """Of a process that has to find this source tree."""
    return os.environ | {"PYTHONPATH": str(ROOT)} | changes


def run(spec: Path, output: Path, *arguments: str) -> Run:
    """Run a spec, and open what it recorded.

    Raises:
        SystemExit: the run is not complete.
    """
    ended = subprocess.run(
        run_command(spec, output, *arguments),
        capture_output=True,
        text=True,
        check=False,
        env=environment(),
    )
    if (output / "record.json").is_file():
        recorded = open_run(output)
        if recorded.record.status == "complete":
            return recorded
    raise SystemExit(f"the run of {spec} failed\n{ended.stderr}")
