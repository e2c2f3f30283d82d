"""Every reader of what strangers and neighbours write, as one function of bytes.

A reader is given bytes and an empty folder. It ends, or raises `AssertionError` where the answer is
not clean: no documented exit status, a crash, control characters, or whatever else must hold. Any
other exception is a failure, too. `read` adds what must hold of every reader.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import functools
import hashlib
import io
import json
import os
import resource
import shutil
import socket
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import CodeType
from typing import Any
from unittest import mock

import msgspec
import mutations
from clean_answers import faults
from hostile_calls import LIVE
from hostile_inputs import DOCUMENTS, KEYS, METADATA, PARAMETERS, SPEC, VALUES, Prototypes
from mutations import Mutation
from rich.console import Console

import tuning_results
from data_bags import chatter, write_mcap, write_ros1
from editor_messages import EXIT, INITIALIZE, SHUTDOWN, framed
from r2bspec.check import check
from r2bspec.cli.internal_error import Crash
from r2bspec.cli.main import main
from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.diagnostics.edits import fix
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.language.json_schema import published_schema
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.record.anatomy_files import AnatomyReader
from r2bspec.record.files import RecordError
from r2bspec.record.run_folder import open_run
from r2bspec.report.finding_formats import FORMATS, render
from r2bspec.tune.patch import patch_spec
from r2bspec.tune.predict import predict_deployment
from r2bspec.tune.tuning_page import to_html
from r2bspec.tune.tuning_report import print_tuning
from r2bspec.tune.tuning_result import TUNING_FILE, read_tuning, to_json
from run_simulation import renew_digests
from simulated_anatomies import CHAIN, ObservedSimulation

TESTS = Path(__file__).parents[1]
CORPUS = Path(__file__).parent / "corpus"
MOST_CPU_S = 10.0
MOST_BYTES = 400_000_000
"""By which an input may raise the memory of the process."""

_FAST = "/dev/shm" if os.path.isdir("/dev/shm") else None  # noqa: PTH112, S108

FILE = "fuzz.r2b.yaml"
ENVIRON = {"HOME": "/home/someone"}


@functools.cache
def _prototypes() -> Prototypes:
    folder = tempfile.TemporaryDirectory(prefix="r2bspec-fuzz-prototypes-")
    prototypes = Prototypes(Path(folder.name))
    vars(prototypes)["keeps"] = folder
    return prototypes


@dataclass(frozen=True)
class Reader:
    """A reader, how its inputs are changed, and inputs to begin with besides the corpus.

    Attributes:
        prepare: makes what all inputs need.
    """

    read: Callable[[bytes, Path], None]
    mutate: Mutation
    seeds: Callable[[], Iterable[bytes]] = tuple
    prepare: Callable[[], object] = _prototypes


def read(name: str, data: bytes) -> None:
    """Give an input to a reader.

    Raises:
        AssertionError: the answer is not clean, takes too much, executes something, or leaves a
            file.
    """
    READERS[name].prepare()
    with tempfile.TemporaryDirectory(prefix="r2bspec-fuzz-", dir=_FAST) as place:
        folder = Path(place) / "work"
        folder.mkdir()
        before = time.process_time(), _most_memory()
        with _watched(Path(place)) as events, _inside(folder):
            READERS[name].read(data, folder)
        assert not events, f"forbidden: {events}"
        assert _most_memory() - before[1] < MOST_BYTES, "too much memory"
        assert time.process_time() - before[0] < MOST_CPU_S, "too much time"
        assert os.listdir(place) == ["work"], "a file is left"


def _most_memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    """Caches and temporary files lie beside the folder, in which this is."""
    before, temporary = Path.cwd(), tempfile.tempdir
    os.chdir(folder)
    tempfile.tempdir = str(folder.parent)
    try:
        with mock.patch.dict(os.environ, XDG_CACHE_HOME=str(folder / "cache"), NO_COLOR="1"):
            yield
    finally:
        os.chdir(before)
        tempfile.tempdir = temporary


_PROGRAMS = {"os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "os.system", "subprocess.Popen"}
_CHANGES = {"os.chmod", "os.mkdir", "os.remove", "os.rmdir"}
_MOVES = {"os.link", "os.rename", "os.symlink"}
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
_watch: list[tuple[Path, list[str]]] = []


@contextlib.contextmanager
def _watched(place: Path) -> Iterator[list[str]]:
    """What starts a program, runs a file of the folder, or writes elsewhere, meanwhile."""
    _begin_audit()
    events: list[str] = []
    _watch.append((place, events))
    try:
        yield events
    finally:
        _watch.clear()


@functools.cache
def _begin_audit() -> None:
    sys.addaudithook(_audit)


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    if not _watch:
        return
    place, events = _watch[0]
    if event == "open":
        path, _, flags = arguments
        is_forbidden = bool(flags & _WRITING) and not _is_below(path, place)
    elif event in _CHANGES:
        is_forbidden = not _is_below(arguments[0], place)
    elif event in _MOVES:
        is_forbidden = not _is_below(arguments[1], place)
    elif event == "exec":
        # Code that a library makes, such as cattrs, has no file; its name may be empty.
        file = arguments[0].co_filename if isinstance(arguments[0], CodeType) else ""
        is_forbidden = not file.startswith("<") and file != "" and _is_below(file, place)
    else:
        is_forbidden = event in _PROGRAMS
    if is_forbidden:
        events.append(f"{event} {arguments[:1]}"[:200])


def _is_below(path: Any, place: Path) -> bool:
    if isinstance(path, int) or path is None:
        return True
    name = os.path.abspath(os.fsdecode(path))  # noqa: PTH100 - as fast as can be
    return name.startswith((str(place), "/dev/null"))


def answered(*calls: tuple[str, ...]) -> None:
    """Make calls of r2bspec in this process, each of which must be answered cleanly."""
    for arguments in calls:
        said = io.BytesIO()
        stream = io.TextIOWrapper(said, encoding="utf-8", write_through=True)
        with (
            contextlib.redirect_stdout(stream),
            contextlib.redirect_stderr(stream),
            mock.patch.object(Crash, "of", _raise),
        ):
            code = main(list(arguments))
        wrong = [what for is_wrong, what in faults(code, said.getvalue()) if is_wrong]
        assert not wrong, (arguments, wrong, said.getvalue()[-2000:])


def _raise(error: BaseException, doing: str = "") -> Crash:
    raise error


# ---- specs and their files ----


def _spec(data: bytes, folder: Path) -> None:
    """Load, check, render and repair; plan what is valid."""
    loaded = _load(data)
    findings = check(loaded, offline=True)
    errors = [finding for finding in loaded.diagnostics if finding.severity is Severity.ERROR]
    assert (loaded.spec is None) == bool(errors), "a spec, or a reason why there is none"
    _check_spans(loaded, findings)
    for name in FORMATS:
        render(name, findings, loaded.texts).encode()
    if loaded.spec is not None:
        again = load_spec(loaded.resolved_yaml(), file=FILE, environ=ENVIRON)
        assert again.spec == loaded.spec, "the resolved document means the same"
    _repair(loaded)
    (folder / FILE).write_bytes(data)
    answered(("plan", FILE))


def _load(data: bytes | str) -> LoadedSpec:
    return load_spec(data, file=FILE, environ=ENVIRON)


def _check_spans(loaded: LoadedSpec, findings: list[Diagnostic]) -> None:
    source = loaded.sources[FILE]
    for finding in findings:
        span = finding.span
        assert finding.message, "a finding says something"
        assert 1 <= span.line <= span.end_line, span
        assert span.line <= len(source.lines) + 1, span
        assert span.column >= 1, span


def _repair(loaded: LoadedSpec) -> None:
    if any(finding.edit is not None for finding in loaded.diagnostics):
        before = loaded.sources[FILE].text
        fixed = fix(before, FILE, lambda changed: check(_load(changed), offline=True))
        assert fixed.applied or fixed.text == before, "nothing changes without a finding"


def _patch(data: bytes, folder: Path) -> None:
    """A deployment written into a spec, which is valid with it, or why it cannot be."""
    loaded = _load(data)
    if loaded.spec is None:
        return
    nodes = [name for name in loaded.spec.graph.nodes if name.isidentifier()][:3]
    (folder / FILE).write_bytes(data)
    try:
        patch = patch_spec(
            SpecSelection(Path(FILE)), [f"graph.nodes.{name}.nice=7" for name in nodes]
        )
    except UsageError as error:
        assert error.hint  # noqa: PT017 - no test but a reader
        return
    patch.file.write_text(patch.after, encoding="utf-8")
    again = load_spec(patch.after, file=str(patch.file))
    assert again.spec is not None, "what is written is valid"
    assert all(again.spec.graph.nodes[name].nice == 7 for name in nodes), "and says it"


def _specs() -> Iterator[bytes]:
    texts = [f"{SPEC}{key}\n" for key in ("", *KEYS)]
    texts += [SPEC.replace("from: a", f"from: {value}") for value in VALUES]
    yield from (text.encode() for text in texts)
    for file in sorted((TESTS.parent / "specs").rglob("*.r2b.yaml")):
        yield file.read_bytes()


def _words_of_specs() -> list[Any]:
    """Keys and values of the schema, and hostile ones."""
    words: list[Any] = [value.strip("'\"") for value in (*VALUES, *KEYS) if len(value) < 200]
    pending: list[Any] = [published_schema()]
    while pending:
        schema = pending.pop()
        if isinstance(schema, dict):
            words += [*schema.get("properties", ()), *schema.get("enum", ())]
            pending += schema.values()
        elif isinstance(schema, list):
            pending += schema
    return words


def _parameters(data: bytes, folder: Path) -> None:
    (folder / "interfaces").mkdir()
    for name in ("p.yaml", "interfaces/n.yaml"):
        (folder / name).write_bytes(data)
    spec = LIVE.replace("PLACE", "command: [x], parameters: ./p.yaml")
    (folder / FILE).write_text(spec)
    answered(("plan", FILE))


def _launch(data: bytes, folder: Path) -> None:
    name = "a.launch.xml" if data.lstrip().startswith(b"<") else "a.launch.yaml"
    (folder / name).write_bytes(data)
    answered(("init", "drafted", "--from-launch", name))


def _script(data: bytes, folder: Path) -> None:
    (folder / "a.py").write_bytes(data)
    answered(("import", "a.py"), ("import", "--check", "a.py"))


def _scripts() -> Iterator[bytes]:
    for file in sorted((TESTS / "golden/script_import/scripts").glob("*.py")):
        yield file.read_bytes()


MARKUP = """<launch>
  <arg name="a" default="b"/>
  <node_container pkg="rclcpp_components" exec="component_container" name="c" namespace="">
    <composable_node pkg="p" plugin="p::P" name="n"><remap from="x" to="$(var a)"/>
    </composable_node>
  </node_container>
  <group><push-ros-namespace namespace="s"/><node pkg="p" exec="e" args="$(env HOME)"/></group>
</launch>
"""
_LAUNCH_WORDS = (
    *("launch", "node", "group", "include", "arg", "let", "param", "remap", "env", "set_env"),
    *("push_ros_namespace", "push-ros-namespace", "node_container", "composable_node", "timer"),
    *("load_composable_node", "executable", "pkg", "exec", "name", "namespace", "plugin", "args"),
    *("if", "unless", "file", "from", "to", "value", "default", "period", "children", "sep"),
    *("$(var a)", "$(var ", "$(dirname)", "$(env HOME)", "$(eval '1+1')", "$(find-pkg-share x)"),
    *("$(command 'id')", "$(not $(var a))", "$(equals 1 1)", "$($($(", "true", "0x10", "1e9", "a"),
)

# ---- recordings ----


def _sqlite(data: bytes, folder: Path) -> None:
    """The storage file of a bag, or its metadata.yaml."""
    shutil.copytree(_prototypes().bag, folder / "bag")
    is_storage = data.startswith(b"SQLite")
    (folder / "bag" / ("bag.db3" if is_storage else "metadata.yaml")).write_bytes(data)
    lone = (("data", "info", "bag/bag.db3"),) if is_storage else ()
    answered(("data", "info", "bag"), ("data", "verify", "bag"), *lone)


def _bag_file(suffix: str, data: bytes, folder: Path) -> None:
    (folder / f"bag{suffix}").write_bytes(data)
    answered(("data", "info", f"bag{suffix}"), ("data", "verify", f"bag{suffix}"))


def _sqlite_seeds() -> Iterator[bytes]:
    for folder in (_prototypes().bag, _prototypes().packed):
        yield next(folder.glob("*.db3")).read_bytes()
        metadata = (folder / "metadata.yaml").read_text()
        yield from (metadata.replace(*pair).encode() for pair in (("", ""), *METADATA))


def _bag_seeds(
    write: Callable[..., Path], variants: Iterable[dict[str, Any]], suffix: str
) -> Iterator[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        for number, options in enumerate(variants):
            yield write(Path(folder, f"{number}{suffix}"), chatter(), **options).read_bytes()


def _mcap_seeds() -> Iterator[bytes]:
    from mcap.writer import CompressionType

    kinds = [{"compression": kind} for kind in CompressionType]
    return _bag_seeds(write_mcap, [*kinds, {"use_chunking": False}], ".mcap")


# ---- runs, results and reports ----


def _history(data: bytes, folder: Path) -> None:
    (folder / "history.sqlite").write_bytes(data)
    listing = ("history", "list", "--file", "history.sqlite", "--format")
    answered((*listing, "text"), (*listing, "json"))


def _record(data: bytes, folder: Path) -> None:
    """A result or report; or ``{record.json: ..., plan.json: ...}``, whose hash is made true."""
    documents = _json_of(data)
    if not isinstance(documents, dict) or not isinstance(documents.get("record.json"), dict):
        (folder / "x.json").write_bytes(data)
        answered(
            *(("compare", "x.json", "x.json"), ("report", "x.json", "--report", "markdown=-")),
            ("import", "x.json"),
        )
        return
    run = _run_in(folder)
    plan = json.dumps(documents.get("plan.json"))
    documents["record.json"]["plan_hash"] = f"sha256:{hashlib.sha256(plan.encode()).hexdigest()}"
    for name, content in documents.items():
        if name in ("record.json", "plan.json"):
            (run / name).write_text(json.dumps(content))
    _judge()


def _json_of(data: bytes) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        return data.decode(errors="replace")


def _run_in(folder: Path) -> Path:
    run = folder / "run"
    shutil.copytree(_prototypes().run, run)
    return run


def _judge() -> None:
    answered(
        *(("judge", "run"), ("compare", "run", "run")),
        *(("report", "run", "--report", f"{name}=-") for name in ("junit", "text")),
    )


def _record_seeds() -> Iterator[bytes]:
    run = _prototypes().run
    names = ("record.json", "plan.json")
    yield json.dumps({name: json.loads((run / name).read_text()) for name in names}).encode()
    yield (run / "result.json").read_bytes()
    yield from (document.encode() for document in DOCUMENTS)


def _tuning(data: bytes, folder: Path) -> None:
    """The result of a search, as it is resumed and shown."""
    (folder / TUNING_FILE).write_bytes(data)
    try:
        result = read_tuning(folder)
    except RecordError as error:
        assert error.hint  # noqa: PT017 - no test but a reader
        return
    assert b"\x1b" not in to_json(result)
    assert b"\x1b" not in to_html(result)
    print_tuning(result, Console(file=io.StringIO(), width=100))


def _fonts() -> None:
    """Matplotlib looks for the fonts of the system once, with a program."""
    import matplotlib.font_manager  # noqa: F401


def _tuning_seeds() -> Iterator[bytes]:
    made = (tuning_results.improved, tuning_results.not_met, tuning_results.hostile)
    return (to_json(make()) for make in made)


def _arrays(data: bytes, folder: Path) -> None:
    """The first byte tells which array it is."""
    run = _run_in(folder)
    files = sorted(run.rglob("*.npy"))
    files[data[0] % len(files) if data else 0].write_bytes(data[1:])
    renew_digests(run)
    _judge()


def _arrays_seeds() -> Iterator[bytes]:
    for number, file in enumerate(sorted(_prototypes().run.rglob("*.npy"))):
        yield bytes([number]) + file.read_bytes()


@functools.cache
def _observed_run() -> Path:
    """A run that was observed from inside."""
    folder = tempfile.mkdtemp(prefix="r2bspec-fuzz-observed-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    graph = replace(CHAIN, rate_hz=40.0, steps=60)
    return ObservedSimulation.of(graph).write(Path(folder, "run")).folder


def _anatomy(data: bytes, folder: Path) -> None:
    """The events of an iteration: judged, shown, and a prediction from them."""
    run = folder / "run"
    shutil.copytree(_observed_run(), run)
    for file in run.rglob("anatomy.npy"):
        file.write_bytes(data)
    renew_digests(run)
    answered(("judge", "run"), ("report", "run", "--report", "trace=trace.json"))
    with contextlib.suppress(RecordError):
        whole = open_run(run)
        found = predict_deployment(whole, whole.plan, rates_hz=(20.0,))
        assert found.reason or found.latencies


def _anatomy_seeds() -> Iterator[bytes]:
    return (file.read_bytes() for file in _observed_run().rglob("anatomy.npy"))


def _events(data: bytes, folder: Path) -> None:
    """A header, the first of 2,048 objects, and rows."""
    table = data[4096 : 4096 + 516].ljust(2048 * 516, b"\0")
    (folder / "node.1.rows").write_bytes(data[:4096] + table + data[4096 + 516 :])
    with contextlib.suppress(RecordError):
        rows, objects, processes = AnatomyReader(folder).read()
        assert (rows["object"] <= len(objects)).all()
        assert (rows["process"] < len(processes)).all()


def _events_seeds() -> Iterator[bytes]:
    header = struct.pack("<8sII256s48x", b"R2BROWS1", 1, 1, b"node")
    header += struct.pack("<IIQ3760x", 1, 1, 0)
    named = struct.pack("<I256s256s", 1, b"/topic", b"/node")
    rows = (struct.pack("<IIIHHqqqqqq", 1, 0, 7, kind, 0, 5, 6, 1, 2, 3, 4) for kind in (1, 2, 4))
    yield header + named + b"".join(rows)


# ---- what processes say to each other ----


def _control(data: bytes, folder: Path) -> None:
    """Replies to a controller from native parts and from Python, and commands to a child."""
    from r2bspec.execute.processes.process import ManagedProcess
    from r2bspec.harness.control_channel import Channel, ChannelClosedError
    from r2bspec.ipc import protocol

    player = protocol.ConfigurePlayer(inputs=(), buffer_dir=".", rows="rows")
    monitor = protocol.ConfigureMonitor(monitors=(), rows_dir=".")
    process: Any = None
    for is_native, command in ((True, player), (True, monitor), (False, None)):
        with _sent(data) as end:
            child = ManagedProcess("x", "x", process, folder / "log", end, native=is_native)
            if command is not None:
                child.send(command)
            while child.read():
                pass
            assert all(isinstance(reply, protocol.Reply) for reply in child.inbox)
    refused = ChannelClosedError, msgspec.DecodeError, ValueError
    with _sent(data) as end, contextlib.suppress(*refused):
        channel = Channel(end)
        while True:
            assert isinstance(channel.receive(), protocol.Command)


@contextlib.contextmanager
def _sent(data: bytes) -> Iterator[socket.socket]:
    """A socket whose other end has sent the data, and sends no more."""
    near, far = socket.socketpair()
    with near, far:
        far.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            far.sendall(data)
        far.shutdown(socket.SHUT_WR)
        yield near


def _control_seeds() -> Iterator[bytes]:
    from r2bspec.ipc import protocol

    yield b"ready\nready 1 0\nmatched 1 -1\nplayed 5\nfailed R2B630 x\nfailed errno 28 /x: full\n"
    for base in (protocol.Command, protocol.Reply):
        for kind in base.__subclasses__():
            yield json.dumps(_example(kind)).encode() + b"\n"


def _example(kind: Any) -> dict[str, Any]:
    """A message of a type, as JSON, with the fields that it must have."""
    return {"type": kind.__name__} | {
        field.encode_name: _EXAMPLES.get(str(field.type).partition("[")[0], "x")
        for field in msgspec.structs.fields(kind)
        if field.required
    }


_EXAMPLES = {"dict": {}, "tuple": [], "<class 'int'>": 1, "<class 'float'>": 1.5}


def _join(data: bytes, folder: Path) -> None:
    """What processes of a graph say when they connect, each up to a zero byte."""
    from r2bspec.execute.bringup import harness_processes

    supervisor: Any = None
    joins = harness_processes.GraphJoins(supervisor, folder, Path("x"), Path("x"))
    with mock.patch.object(harness_processes, "_HELLO_TIMEOUT_S", 0.01):
        for words in data.split(b"\0")[:8]:
            with socket.socket(socket.AF_UNIX) as asking:
                asking.connect(joins.environment("x", {})["R2BSPEC_JOIN_SOCKET"])
                asking.sendall(words[:4096])
                joins.poll()
        for hello, _ in joins._asking:
            harness_processes.is_target_process(hello, hello.process)
        joins.close()


def _lsp(data: bytes, folder: Path) -> None:
    """A list of messages, of which texts are sent as they are; what follows is answered."""
    from r2bspec.language_server.server import create_server

    messages = _json_of(data)
    messages = messages if isinstance(messages, list) else [messages]
    sent = b"".join(
        message.encode("utf-8", "surrogatepass") if isinstance(message, str) else framed(message)
        for message in messages[:20]
    )
    sent = INITIALIZE + sent + SHUTDOWN + EXIT
    defects: list[BaseException] = []

    def keep(error: BaseException) -> str:
        defects.append(error)
        return "a defect"

    server = create_server(keep)
    vars(server)["start_command"] = lambda *_: None
    received, log = io.BytesIO(), io.StringIO()
    with contextlib.redirect_stderr(log):
        stream: io.BufferedReader = io.BufferedReader(io.BytesIO(sent))
        asyncio.run(server.connection.serve(stream, received))
    for defect in defects:
        raise defect
    assert not log.getvalue(), log.getvalue()[-2000:]
    if not any(isinstance(message, str) or "exit" in str(message) for message in messages):
        assert b'"id":"shutdown"' in received.getvalue(), "no answer"


def _lsp_seeds() -> Iterator[bytes]:
    from lsprotocol import types

    uri = f"file:///{FILE}"
    text = SPEC.replace("match: order", "match: sorted")
    place = {"textDocument": {"uri": uri}, "position": {"line": 3, "character": 8}}
    place |= {"range": {"start": place["position"], "end": place["position"]}}
    place |= {"context": {"diagnostics": [], "includeDeclaration": True}, "newName": "b"}
    item = {"uri": uri, "languageId": "yaml", "version": 1, "text": text}
    opened = {"method": "textDocument/didOpen", "params": {"textDocument": item}, "jsonrpc": "2.0"}
    methods = [name for name in types.METHOD_TO_TYPES if name.startswith("textDocument/")]
    for method in methods:
        params = place | {"positions": [place["position"]]}
        asked = {"jsonrpc": "2.0", "id": method, "method": method, "params": params}
        yield json.dumps([opened, asked, "Content-Length: 2\n\n{}"]).encode()


def _fleet(data: bytes, folder: Path) -> None:
    """The archive of a run, a journal, a request to a host, or its answer to whatever it was."""
    from r2bspec.fleet.host_service import HostService
    from r2bspec.fleet.host_store import HostStore, unpack_run
    from r2bspec.fleet.hosts import HostFacts
    from r2bspec.fleet.journal import JOURNAL_FILE, read_journal
    from r2bspec.fleet.messages import METHODS, HostState, answer_of, read_answer

    for name in (JOURNAL_FILE, "run.tar.gz"):
        (folder / name).write_bytes(data)
    with contextlib.suppress(R2bspecError):
        read_journal(folder)
    with contextlib.suppress(R2bspecError):
        unpack_run(folder / "run.tar.gz", folder / "run")
    store = HostStore(folder / "host")
    store.open()
    service = HostService(HostFacts(name="x"), store)
    vars(service)["_run_child"] = lambda *_: 1
    assert msgspec.msgpack.decode(service.answer(data))
    answer: Any = None
    with contextlib.suppress(msgspec.MsgspecError, UnicodeDecodeError):
        answer = msgspec.msgpack.decode(data)
        for kind in (HostFacts, HostState):
            msgspec.convert(answer, kind)
    if isinstance(answer, dict) and "request" in answer:
        answer["request"] = msgspec.msgpack.decode(answer_of(b"x"))["request"]
    for method in METHODS:
        with contextlib.suppress(R2bspecError):
            read_answer("x", method, b"x", msgspec.msgpack.encode(answer))


def _fleet_seeds() -> Iterator[bytes]:
    from r2bspec.fleet.bundle import Job, SentFile, SentRecording, make_bundle
    from r2bspec.fleet.host_store import pack_run
    from r2bspec.fleet.messages import Call, FleetRunState, Problem, RunEnded, answer_of, request_of
    from r2bspec.plan.prepared_benchmark import PreparedBenchmark

    with tempfile.TemporaryDirectory() as folder:
        pack_run(_prototypes().run, Path(folder, "run.tar.gz"))
        yield Path(folder, "run.tar.gz").read_bytes()
        plan = open_run(_prototypes().run).plan
        (head,) = make_bundle([PreparedBenchmark(plan, Path(folder), SPEC)]).sides
    sent = SentFile(path="a/b.py", size=2, sha256=hashlib.sha256(b"ab").hexdigest())
    recordings = (SentRecording(path="../bag", sha256="0" * 64),)
    job = Job(
        identity="1" * 32, name="x", bundle="0" * 64, files=(), recordings=recordings, head=head
    )
    jobs = (job, msgspec.structs.replace(job, files=(sent,), base=head))
    calls = [Call(method, (job,)) for method in ("prepare", "play") for job in jobs]
    calls += [
        Call("put", (sent, 0, b"ab")),
        Call("read", ("1" * 32, 0, 9)),
        Call("drop", ("1" * 32,)),
    ]
    yield from map(request_of, calls)
    problem = Problem(code="R2B600", message="x")
    for value in ({"0" * 64: 1}, RunEnded(outcome="pass", problem=problem), b"ab"):
        yield answer_of(b"x", value)
    yield answer_of(b"x", problem=problem)
    yield msgspec.msgpack.encode(FleetRunState(name="x", p99_ns=5))
    yield b'{"at": "", "suite": "x"}\n{"at": "", "run": "a", "host": "h", "state": "sent"}\n'


# ---- the player in C ----


@functools.cache
def _player() -> Any:
    from native_playlists import SANITIZERS, LonePlayer, player_without_ros

    return LonePlayer(player_without_ros(SANITIZERS)).__enter__()


def _playback(data: bytes, folder: Path) -> None:
    """A playlist and a playback file, after the size of the first."""
    size = int.from_bytes(data[:4], "little")
    (folder / "playlist").write_bytes(data[4 : 4 + size])
    (folder / "playback").write_bytes(data[4 + size :])
    (folder / "buffer").write_bytes(bytes(48))
    buffers = [folder / "buffer"] * 2
    said = _player().play(folder / "playlist", folder / "playback", buffers)
    assert "played" in said or "damaged" in said or "buffer shorter" in said, said


def _playback_seeds() -> Iterator[bytes]:
    from native_playlists import playback_files

    with tempfile.TemporaryDirectory() as folder:
        for files in playback_files(Path(folder)):
            size = len(files.playlist).to_bytes(4, "little")
            yield size + files.playlist + files.playback


def _playback_mutation(data: bytes, rng: Any) -> bytes:
    size = int.from_bytes(data[:4], "little")
    halves = [data[4 : 4 + size], data[4 + size :]]
    half = rng.randrange(2)
    halves[half] = mutations.numbers(halves[half], rng)
    return len(halves[0]).to_bytes(4, "little") + b"".join(halves)


_json = mutations.document(["\x1b]0;x", "../x", *map(str, mutations.NUMBERS)])
_packed = mutations.document(
    ["../x", *mutations.NUMBERS], msgspec.msgpack.decode, msgspec.msgpack.encode
)
_control_words = ("ready", "matched", "played", "failed", "errno", "R2B630", "-1", "9" * 30, "\0")
_files = mutations.by_start({b"<": mutations.xml(_LAUNCH_WORDS)}, mutations.yaml_document())

READERS = {
    "spec": Reader(_spec, mutations.yaml_document(_words_of_specs()), _specs),
    "patch": Reader(_patch, mutations.yaml_document(_words_of_specs()), _specs),
    "parameters": Reader(
        _parameters,
        mutations.yaml_document(["ros__parameters", "/**", "parameters", "publishes", "qos"]),
        lambda: (content.encode() for content in PARAMETERS),
    ),
    "sqlite": Reader(
        _sqlite,
        mutations.by_start(
            {b"SQLite": mutations.sqlite},
            mutations.yaml_document([word for pair in METADATA for word in pair]),
        ),
        _sqlite_seeds,
    ),
    "mcap": Reader(functools.partial(_bag_file, ".mcap"), mutations.mcap, _mcap_seeds),
    "ros1": Reader(
        functools.partial(_bag_file, ".bag"),
        mutations.ros1,
        lambda: _bag_seeds(
            write_ros1, [{"compression": kind} for kind in ("none", "bz2", "lz4")], ".bag"
        ),
    ),
    "history": Reader(_history, mutations.sqlite, lambda: (_prototypes().history.read_bytes(),)),
    "record": Reader(_record, _json, _record_seeds),
    "tuning": Reader(_tuning, _json, _tuning_seeds, _fonts),
    "arrays": Reader(_arrays, mutations.numbers, _arrays_seeds),
    "anatomy": Reader(_anatomy, mutations.numbers, _anatomy_seeds, _observed_run),
    "events": Reader(_events, mutations.numbers, _events_seeds),
    "control": Reader(_control, mutations.text(_control_words), _control_seeds),
    "join": Reader(
        _join,
        mutations.text(("process", "part", "\0", "\n", "x" * 2000)),
        lambda: (b"process x\n\0part player\nready\n\0",),
    ),
    "playback": Reader(_playback, _playback_mutation, _playback_seeds, _player),
    "lsp": Reader(_lsp, _json, _lsp_seeds),
    "script": Reader(_script, mutations.python, _scripts),
    "launch": Reader(_launch, _files, lambda: (MARKUP.encode(),)),
    "fleet": Reader(
        _fleet, mutations.by_start({b"\x1f": mutations.archive}, _packed), _fleet_seeds
    ),
}
"""By the name of the folder of its corpus."""
