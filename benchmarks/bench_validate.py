"""How long `r2bspec validate` takes, beside a validator that applies only the JSON Schema.

::

    pip install check-jsonschema
    python benchmarks/bench_validate.py

Both read the same files; the other tool gets the published schema of this repository. Each case is
run several times, all in turn, each run in a fresh process whose wall time, CPU time and largest
memory are taken from the kernel; the CPU time of processes that it starts counts, too. Shown are
medians, and in parentheses the fastest and the slowest run. One round comes first and is not
counted, so that files are in the cache of the system. Byte code is kept in a folder made for the
purpose, so that all find theirs, as installed programs do. The start of `validate` is compared with
an interpreter that imports yaml and jsonschema.
"""

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

from measuring import ROOT, chain_spec, environment, machine, options, show, table

SPEC = ROOT / "specs" / "apriltag_node.r2b.yaml"
SCHEMA = ROOT / "schemas" / "r2bspec-v1.schema.json"
OURS = "r2bspec validate"
THEIRS = "check-jsonschema"
TOOLS = {
    OURS: [sys.executable, "-m", "r2bspec", "validate", "--quiet"],
    THEIRS: [sys.executable, "-m", "check_jsonschema", "--schemafile", str(SCHEMA)],
}
IMPORTS = [sys.executable, "-c", "import yaml, jsonschema"]


@dataclass(frozen=True, slots=True)
class Run:
    """One run of one tool."""

    seconds: float
    cpu_seconds: float
    memory_bytes: int


def measure(command: list[str], folder: Path) -> Run:
    """Run a command to its end; byte code and indexes of bags are kept in `folder`.

    Raises:
        SystemExit: it found something wrong, so that it did not do the work that is compared.
    """
    environ = environment(
        PYTHONPYCACHEPREFIX=str(folder / "byte_code"),
        XDG_CACHE_HOME=str(folder / "cache"),
        PYTHONDONTWRITEBYTECODE="",
    )
    with tempfile.TemporaryFile() as output:
        start = time.perf_counter()
        process = subprocess.Popen(command, cwd=ROOT, env=environ, stdout=output, stderr=output)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            output.seek(0)
            raise SystemExit(f"{command[:5]} failed:\n{output.read(4000).decode()}")
    return Run(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024)


def compare(commands: dict[str, list[str]], repeat: int, folder: Path) -> dict[str, list[Run]]:
    """Runs of some commands, in turn."""
    runs: dict[str, list[Run]] = {name: [] for name in commands}
    for round_number in range(repeat + 1):
        for name, command in commands.items():
            run = measure(command, folder)
            if round_number:
                runs[name].append(run)
    return runs


def compare_tools(files: list[Path], repeat: int, folder: Path) -> dict[str, list[Run]]:
    """Runs of all tools over the same files."""
    names = [*map(str, files)]
    return compare({tool: [*command, *names] for tool, command in TOOLS.items()}, repeat, folder)


def copies(folder: Path, number: int) -> list[Path]:
    """That many specs, each with a name of its own."""
    text = SPEC.read_text(encoding="utf-8")
    files = [folder / f"spec_{index}.r2b.yaml" for index in range(number)]
    for index, file in enumerate(files):
        file.write_text(text.replace("name: apriltag_node", f"name: apriltag_node_{index}"))
    return files


def kinds(folder: Path, number: int) -> list[Path]:
    """About that many specs: all of this repository, in many copies of their folders."""
    found: list[Path] = []
    while len(found) < number:
        place = folder / f"specs_{len(found)}"
        shutil.copytree(ROOT / "specs", place)
        found += sorted(place.rglob("*.r2b.yaml"))
    return found[:number]


def rows(cases: dict[str, dict[str, list[Run]]]) -> Iterator[list[str]]:
    """The measured times of each case."""
    for case, runs in cases.items():
        memory = {tool: max(run.memory_bytes for run in runs[tool]) / 1e6 for tool in TOOLS}
        yield [
            case,
            *(shown(runs[tool]) for tool in TOOLS),
            ratios(runs[THEIRS], runs[OURS]),
            f"{memory[OURS]:.0f}, {memory[THEIRS]:.0f} MB",
        ]


def medians(runs: list[Run]) -> tuple[float, float]:
    """Wall time and CPU time in seconds."""
    return (
        statistics.median(run.seconds for run in runs),
        statistics.median(run.cpu_seconds for run in runs),
    )


def ratios(one: list[Run], other: list[Run]) -> str:
    """How many times as long one takes as the other."""
    (wall, cpu), (other_wall, other_cpu) = medians(one), medians(other)
    return f"{wall / other_wall:.1f}, CPU {cpu / other_cpu:.1f}"


def start_rows(runs: dict[str, list[Run]]) -> Iterator[list[str]]:
    """The start of the program beside that of an interpreter."""
    base = next(iter(runs))
    for name, found in runs.items():
        wall, cpu = medians(found)
        yield [name, f"{wall:.3f} s", f"{cpu:.3f} s", ratios(found, runs[base])]


def shown(runs: list[Run]) -> str:
    """The median of the wall times, its extremes, and the median of the CPU times."""
    wall, cpu = medians(runs)
    times = [run.seconds for run in runs]
    return f"{wall:.3f} s ({min(times):.3f} to {max(times):.3f}), CPU {cpu:.3f} s"


def growth(small: list[Run], large: list[Run], cold: list[Run]) -> float:
    """How many times as much CPU time the large spec takes as the small one, without start-up."""
    start, first, last = (min(run.cpu_seconds for run in runs) for runs in (cold, small, large))
    return (last - start) / max(first - start, 1e-9)


def main() -> None:
    """Measure, and print what was measured."""
    parser = options(__doc__)
    parser.add_argument("--repeat", type=int, default=5, help="runs of each case and tool")
    parser.add_argument("--files", type=int, default=1000, help="files of the case with many")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        start = {
            "python -c 'import yaml, jsonschema'": IMPORTS,
            "r2bspec validate SPEC": [*TOOLS[OURS], str(SPEC)],
        }
        starts = compare(start, 4 * given.repeat, folder)
        (folder / "copies").mkdir()
        files = copies(folder / "copies", given.files)
        chains = {}
        for nodes in (500, 5000):
            chains[nodes] = folder / f"chain_{nodes}.r2b.yaml"
            chains[nodes].write_text(chain_spec(nodes))
        measured = partial(compare_tools, folder=folder)
        cases = {
            "one spec": measured([SPEC], 2 * given.repeat),
            f"{given.files:,} copies of it": measured(files, given.repeat),
            f"{given.files:,} copies of all specs here": measured(
                kinds(folder, given.files), given.repeat
            ),
            "a spec of 500 nodes": measured([chains[500]], given.repeat),
            "a spec of 5,000 nodes": measured([chains[5000]], given.repeat),
        }
    cold, _, _, small, large = cases.values()
    show(
        f"{machine()}, check-jsonschema {version('check-jsonschema')}, {given.repeat} runs each",
        "",
        *table(("command", "wall time", "CPU", "times that of the first"), start_rows(starts)),
        "",
        *table(("case", OURS, THEIRS, "theirs / ours", "memory"), rows(cases)),
        "",
    )
    for tool in (OURS, THEIRS):
        times = growth(small[tool], large[tool], cold[tool])
        show(f"{tool}: ten times the nodes take {times:.1f} times the CPU time, start-up apart")


if __name__ == "__main__":
    main()
