"""Small benchmarks run on real ROS 2 by the command line, and a watch over what they leave behind.

Nothing here asserts how fast anything is: machines that run tests are shared and slow.
"""

from __future__ import annotations

import contextlib
import copy
import itertools
import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import psutil
import pytest
import yaml
from rosbags.rosbag2 import Writer

from prepared_program import Program, start, start_anew
from r2bspec.bags.message_types import typestore
from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from r2bspec.ipc.sample_files import ArrivalReader
from r2bspec.middleware.fast_dds import MIDDLEWARE
from r2bspec.record.run_folder import Run, open_run
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import MONITOR_FIELDS

_Found = TypeVar("_Found")

HANG_S = 600.0
"""Guards against hanging only; nothing that passes takes so long."""

IMAGE = "sensor_msgs/msg/Image"
STRING = "std_msgs/msg/String"
START_NS = 1_700_000_000_000_000_000
WIDTH, HEIGHT = 64, 48

_SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - where the middleware keeps its segments


def image(number: int, stamp_ns: int, size: tuple[int, int] = (WIDTH, HEIGHT)) -> bytes:
    """A serialised Image, filled with its number."""
    width, height = size
    types = typestore().types
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    header = types["std_msgs/msg/Header"](stamp, "camera")
    pixels = np.full(width * height * 3, number % 256, np.uint8)
    message = types[IMAGE](header, height, width, "rgb8", 0, width * 3, pixels)
    return bytes(typestore().serialize_cdr(message, IMAGE))


def text(words: str) -> bytes:
    """A serialised String, a message that has no header."""
    return bytes(typestore().serialize_cdr(typestore().types[STRING](data=words), STRING))


def write_bag(
    folder: Path,
    topics: Mapping[str, Sequence[int]],
    size: tuple[int, int] = (WIDTH, HEIGHT),
    recorded_ms: Sequence[int] | None = None,
) -> Path:
    """Write a bag of images, one for each stamp in milliseconds; of strings for ``/text``.

    They are recorded at their stamps, or at the times of `recorded_ms`.
    """
    with Writer(folder, version=9) as writer:
        rows = []
        for topic, stamps_ms in topics.items():
            kind = STRING if topic == "/text" else IMAGE
            connection = writer.add_connection(topic, kind, typestore=typestore())
            for number, stamp_ms in enumerate(stamps_ms):
                stamp_ns = START_NS + stamp_ms * 1_000_000
                data = text(f"{number}") if kind == STRING else image(number, stamp_ns, size)
                time_ms = stamp_ms if recorded_ms is None else recorded_ms[number]
                rows.append((START_NS + time_ms * 1_000_000, connection, data))
        for time_ns, connection, data in sorted(rows, key=lambda row: row[0]):
            writer.write(connection, time_ns, data)
    return folder


def relay_spec(**changes: Any) -> dict[str, Any]:
    """A benchmark of one RelayNode, quick to run; `changes` replace whole sections."""
    spec: dict[str, Any] = {
        "r2bspec": 1,
        "name": "relay",
        "data_loader": {"bag": "./bag", "topics": {"/camera": "loaded"}},
        "playback": {"buffer": 5, "inputs": {"input": quick_input("loaded")}},
        "graph": {"nodes": {"relay": relay_node()}},
        "monitors": {"out": {"topic": "output", "format": IMAGE}},
        "benchmark": {
            "duration": "1 s",
            "iterations": 1,
            "starts": 1,
            "rates": ["20 Hz"],
            "warm_up": "100 ms",
            "start_timeout": "60 s",
            # Tests are run on busy machines, too; host interference has tests of its own.
            "gate": {"interference": "tolerate"},
        },
    }
    return spec | copy.deepcopy(changes)


MEASURED = {"buffer": 5, "inputs": {"input": {"from": "loaded", "format": IMAGE}}}
"""Playback with an input that is volatile, unlike that of `quick_input`."""


def quick_input(source: str, kind: str = IMAGE) -> dict[str, Any]:
    """An input as a spec declares it.

    It is kept for late joiners, which nobody here is.
    """
    return {"from": source, "format": kind, "qos": {"durability": "transient_local"}}


def relay_node(service_time_ms: float = 1.0, **changes: Any) -> dict[str, Any]:
    """A RelayNode as a spec declares it; its queue outlasts long hiccups of the machine."""
    parameters = {"format": IMAGE, "service_time_ms": service_time_ms, "queue_depth": 100}
    return {"python": "r2bspec.nodes.RelayNode", "parameters": parameters} | changes


@dataclass(frozen=True)
class Finished:
    """A command that has ended."""

    status: int
    stdout: str
    stderr: str
    folder: Path

    def assert_complete(self) -> None:
        """See that the run went to its end.

        A run on a machine so loaded that the playback missed its schedule is complete, too, and
        its counts are right; only its times are of no use.
        """
        assert self.status == 0 or self.outcome == "invalid", self.stderr
        assert self.run().record.status == "complete"

    @property
    def outcome(self) -> str:
        """The outcome of the verdict."""
        return str(self.result()["verdict"]["outcome"])

    @property
    def error(self) -> str:
        """The error that the user was shown, with its hint, without what progress said before.

        An error that has a place in the spec is shown as a finding there.
        """
        found = re.search(r"^(?:\S+:\d+:\d+: )?(error\[.*)", self.stderr, re.MULTILINE | re.DOTALL)
        assert found, f"no error was shown:\n{self.stderr}"
        return found[1]

    def run(self) -> Run:
        """The run folder, opened."""
        return open_run(self.folder)

    def result(self) -> Any:
        """What result.json holds."""
        return json.loads((self.folder / "result.json").read_text())

    def pooled(self) -> Any:
        """The pooled metrics of the only rate."""
        (rate,) = self.result()["metrics"]["rates"]
        return rate["pooled"]

    def monitor(self, name: str = "out") -> Any:
        """The metrics of a monitor at the only rate, and what else is known of it."""
        seen = self.pooled()["monitors"][name]
        return {**seen, **seen["values"]}

    def requirement(self, text: str) -> Any:
        """The verdict of the only requirement that begins with a text."""
        requirements = self.result()["verdict"]["requirements"]
        (found,) = (
            requirement for requirement in requirements if requirement["text"].startswith(text)
        )
        return found

    def segments(self, kind: str = "iteration") -> list[Segment]:
        """The segments of a kind, in the order in which they were played."""
        return [segment for segment in self.run().record.segments if segment.kind == kind]

    @property
    def words(self) -> str:
        """The report, without its line breaks."""
        return " ".join(self.stdout.split())

    def assert_counts(self, steps: int, monitor: str = "out") -> None:
        """See that the run is complete, and that each of so many steps was answered."""
        self.assert_complete()
        found = self.monitor(monitor)
        seen = (found["sent"], found["received"], found["answered"], found["missed"])
        assert seen == (steps, steps, steps, 0), found

    def events(self) -> list[str]:
        """What the record says happened, in order."""
        return [text for _, text in self.run().record.events]

    def log(self, process: str) -> str:
        """What a process printed."""
        return (self.folder / "logs" / f"{process}.log").read_text()


class Bench:
    """A folder with a bag and specs, and the runs that are made of them."""

    def __init__(
        self,
        folder: Path,
        topics: Mapping[str, Sequence[int]] | None = None,
        size: tuple[int, int] = (WIDTH, HEIGHT),
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.bag = write_bag(folder / "bag", topics or {"/camera": range(0, 330, 33)}, size)
        self.run_ids: set[str] = set()
        self._numbers = iter(range(1, 1_000))
        _benches.append(self)

    def write(self, spec: Mapping[str, Any], name: str = "spec") -> Path:
        """Write a spec file."""
        path = self.folder / f"{name}.r2b.yaml"
        path.write_text(yaml.safe_dump(dict(spec), sort_keys=False))
        return path

    def write_node(self, name: str, code: str) -> None:
        """Write a Python file beside the specs."""
        (self.folder / name).write_text(NODE_IMPORTS + code)

    def start(
        self,
        spec: Mapping[str, Any] | Path,
        *arguments: str,
        output: Path | None = None,
        through: Sequence[str] = (),
        verb: str = "run",
    ) -> Running:
        """Start a verb, `through` another program; whoever starts it sees to its end."""
        number = next(self._numbers)
        path = spec if isinstance(spec, Path) else self.write(spec, f"spec{number}")
        folder = output or self.folder / f"run{number}"
        words = [*verb.split(), str(path), "--output", str(folder), *arguments]
        return Running(self, words, folder, through)

    def run(
        self, spec: Mapping[str, Any] | Path, *arguments: str, output: Path | None = None
    ) -> Finished:
        """Run a spec to its end."""
        with self.start(spec, *arguments, output=output) as running:
            return running.finish()

    def compare(self, spec: Mapping[str, Any] | Path, *arguments: str) -> Finished:
        """Compare a spec with a base to the end."""
        with self.start(spec, *arguments, verb="compare") as running:
            return running.finish()

    def run_until_valid(self, spec: Mapping[str, Any], *arguments: str) -> Finished:
        """Run a spec to its end, again while its playback was late, as exit status 4 advises.

        Raises:
            AssertionError: no run was valid in `HANG_S`; its rates are too high for tests.
        """
        deadline = time.monotonic() + HANG_S
        while (finished := self.run(spec, *arguments)).status == 4:
            assert finished.outcome == "invalid", finished.stderr
            assert time.monotonic() < deadline, finished.words
        return finished

    def judge(self, folder: Path, *arguments: str) -> Finished:
        """Judge a run again."""
        with Running(self, ["judge", str(folder), *arguments], folder) as running:
            return running.finish()

    def processes(self) -> list[psutil.Process]:
        """Every process that works in this folder, or carries the id of one of its runs."""
        return [each for each in psutil.process_iter() if _bench_of(each) is self]


@pytest.fixture(scope="module")
def bench(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A bench for the runs of a module, which imports this fixture: with its `NODES`, if it has
    any, in ``nodes.py``, and its `TOPICS` recorded.
    """
    module = request.module
    made = Bench(tmp_path_factory.mktemp(module.__name__), getattr(module, "TOPICS", None))
    made.write_node("nodes.py", getattr(module, "NODES", ""))
    return made


_DISCOVERY = re.compile(r"fast\w+_port7[0-3]\d\d")
"""Ports below those of domain 0, which all domains of a machine share for discovery."""

_numbers = itertools.count(1)
_benches: list[Bench] = []
_seen_segments: set[str] = set()
"""The names of those that processes of runs have used."""

NODE_IMPORTS = "from rclpy.node import Node\nfrom sensor_msgs.msg import Image\n"

WORKER = """
class Worker(Node):
    def __init__(self, **kwargs):
        super().__init__("worker", **kwargs)
        self.steps = self.declare_parameter("steps", 0).value
        self.publisher = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", self.work, 10)

    def work(self, message):
        x = 0
        for i in range(self.steps):
            x += i * i
        self.publisher.publish(message)
"""
"""A node that computes for each image, without its imports."""


class Running:
    """A command under way, whose processes and segments are watched."""

    def __init__(
        self, bench: Bench, arguments: list[str], folder: Path, through: Sequence[str] = ()
    ) -> None:
        self.folder = folder
        self._bench = bench
        # Runs also use, and leave alone, what the dead of others have left.
        self._before = {path.name for path in _SHARED_MEMORY.glob("fast*")}
        self._output = {
            name: (bench.folder / f".{name}-{next(_numbers)}") for name in ("stdout", "stderr")
        }
        output = (self._output["stdout"], self._output["stderr"])
        if through:
            command = [*through, sys.executable, "-m", "r2bspec", *arguments]
            self.process: Program = start_anew(command, bench.folder, output)
        else:
            self.process = start(arguments, bench.folder, output)
        self._ended = threading.Event()
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()

    def __enter__(self) -> Running:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._ended.set()
        self._watcher.join()

    def stderr(self) -> str:
        """What it has said so far."""
        return self._output["stderr"].read_text()

    def stdout(self) -> str:
        """What it has reported so far."""
        return self._output["stdout"].read_text()

    def wait_for(self, pattern: str) -> None:
        """Wait until it has said something on standard error."""
        self.wait_until(lambda: re.search(pattern, self.stderr()), repr(pattern))

    def wait_until(self, found: Callable[[], _Found | None], what: str) -> _Found:
        """Wait until something is there, and return it.

        Raises:
            AssertionError: the run ended, or nearly hung, before.
        """
        deadline = time.monotonic() + HANG_S
        while not (answer := found()):
            assert self.process.poll() is None, f"ended before {what}:\n{self.stderr()}"
            assert time.monotonic() < deadline, f"{what} never came:\n{self.stderr()}"
            time.sleep(0.02)
        return answer

    def child(self, name: str) -> psutil.Process:
        """One of its processes, by the name of its log; waits until it runs."""

        def with_its_log() -> psutil.Process | None:
            log = self.folder / "logs" / f"{name}.log"
            for process in self._bench.processes():
                with contextlib.suppress(psutil.Error, OSError):
                    if Path(f"/proc/{process.pid}/fd/1").readlink() == log:
                        return process
            return None

        return self.wait_until(with_its_log, f"process {name}")

    def wait_for_messages(self, monitor_name: str, count: int) -> None:
        """Wait until a monitor has recorded this many further messages."""
        process = self.child("monitor")

        def received() -> int:
            return sum(
                ArrivalReader(open_file, MONITOR_FIELDS).count()
                for open_file in _open_files(process)
                if open_file.name == f"{monitor_name}.rows"
            )

        wanted = received() + count
        self.wait_until(lambda: received() >= wanted, f"{count} messages")

    def finish(self) -> Finished:
        """Wait for its end."""
        try:
            status = self.process.wait(HANG_S)
        except subprocess.TimeoutExpired:
            pytest.fail(f"it hangs:\n{self.stderr()}")
        self.sample()
        # Whatever happens, a user is never shown a stack trace, but in what a node has printed.
        own = self.stderr().partition("Its last output:")[0]
        assert "Traceback (most recent call last)" not in own, self.stderr()
        return Finished(status, self.stdout(), self.stderr(), self.folder)

    def sample(self) -> None:
        """Take note of the shared memory that its processes use."""
        note_segments(self._bench, self._before)

    def _watch(self) -> None:
        while not self._ended.wait(0.5):
            self.sample()


def _open_files(process: psutil.Process) -> list[Path]:
    """The regular files that a process has open."""
    with contextlib.suppress(psutil.Error):
        return [Path(open_file.path) for open_file in process.open_files()]
    return []


@contextlib.contextmanager
def node_of_others(
    command: Sequence[str | Path], **settings: Any
) -> Iterator[subprocess.Popen[bytes]]:
    """A node that no run has started. It is killed, and what it leaves behind is put away.

    A node that leaves at the same time as others may wait in the middleware without end, so that a
    signal that asks it to leave is not enough.
    """
    began_s = time.time()
    with subprocess.Popen(command, stdout=subprocess.PIPE, **settings) as process:
        try:
            yield process
        finally:
            mapped = _maps(process.pid)
            process.kill()
    # Whoever looks at the same time may hold a lock for a moment.
    while mapped.intersection(MIDDLEWARE.dead_shm_files(since_s=began_s)):
        MIDDLEWARE.remove_dead_shm_files(since_s=began_s)
        time.sleep(0.03)


def note_segments(bench: Bench, before: set[str]) -> None:
    """Take note of the shared memory that is in use now, but for what was there before."""
    for process in bench.processes():
        _seen_segments.update(_maps(process.pid) - before)


def _bench_of(process: psutil.Process) -> Bench | None:
    """The bench that a process works for, by its folder, or by the id of a run seen there."""
    if process.pid == os.getpid():
        return None
    try:
        if process.status() == psutil.STATUS_ZOMBIE:
            return None
        run_id = process.environ().get(RUN_ID_VARIABLE, "")
        place = f"{process.cwd()}/"
    except (psutil.Error, OSError):
        return None
    for bench in _benches:
        if place.startswith(f"{bench.folder}/"):
            bench.run_ids |= {run_id} - {""}
            return bench
    return next((bench for bench in _benches if run_id in bench.run_ids), None)


def _maps(pid: int) -> set[str]:
    """The segments of the middleware that a process maps."""
    with contextlib.suppress(OSError):
        maps = Path(f"/proc/{pid}/maps").read_text()
        found = re.findall(rf"{_SHARED_MEMORY}/(fast\w+)$", maps, re.MULTILINE)
        return {name for name in found if not _DISCOVERY.fullmatch(name)}
    return set()


def left_behind() -> list[str]:
    """Processes, and segments that nobody uses, which runs of these tests have left, in words."""
    if not _benches:
        return []
    left = []
    there = {name for name in _seen_segments if (_SHARED_MEMORY / name).exists()}
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if _bench_of(process) is not None:
                left.append(f"process {process.pid}: {' '.join(process.cmdline())}")
        there -= _maps(process.pid) if there else set()
    return left + [f"segment {name}" for name in sorted(there)]


def assert_nothing_left() -> None:
    """Promise: whatever happens in a run, nothing of it is left."""
    # What the watchdog does after a SIGKILL may take it some seconds.
    deadline = time.monotonic() + 10.0
    while left := left_behind():
        if time.monotonic() > deadline:
            for process in psutil.process_iter():
                with contextlib.suppress(psutil.Error):
                    if _bench_of(process) is not None:
                        process.kill()
            _seen_segments.clear()
            pytest.fail("left behind:\n" + "\n".join(left))
        time.sleep(0.1)
