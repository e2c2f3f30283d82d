"""The preprocess phase: recorded messages go through the preprocessors, and what comes out is kept.

The preprocessors are ended before anything is measured, so that they take no processor time from
the graph under test.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from r2bspec.execute.bringup.launcher import (
    Launcher,
    explain,
    listeners,
    readers_wanted,
    wait_until_matched,
)
from r2bspec.execute.bringup.spec_mismatches import suspicions
from r2bspec.execute.bringup.start_deadline import StartDeadline
from r2bspec.execute.diagnosis.graph_facts import Facts
from r2bspec.execute.diagnosis.observe_graph import PLAY_HZ, PLAY_STEPS, Observer, breaks_of, told
from r2bspec.execute.errors import NoOutputError
from r2bspec.execute.processes.supervisor import Child, Children
from r2bspec.ipc import protocol
from r2bspec.ipc.buffers import buffered_transforms
from r2bspec.ipc.transform_stamps import TF, TF_STATIC, TF_TYPE
from r2bspec.plan.command_lines import HARNESS_ARGV
from r2bspec.plan.plan import Plan, ProcessPlan

_PHASE: Final = "preprocess"
_LOAD_S = 3600.0
_PLAY_S = 60.0


def preprocess(
    plan: Plan,
    children: Children,
    launcher: Launcher,
    buffer_dir: Path,
    note: Callable[[str], None],
) -> None:
    """Run the preprocessors over everything that was buffered from the bag.

    Raises:
        NoOutputError: a recorded topic got no message.
        RunError: a process died, failed, or was not ready in time.
    """
    processes = [each for each in plan.processes if each.phase == _PHASE]
    recorded = {each.source: each.type for each in plan.inputs if not each.bag_topic}
    read = {
        each.name: set(each.readers) - {"loader"}
        for each in plan.topics
        if each.phase == _PHASE and "loader" in each.writers
    }
    datasets = plan.datasets or (plan.dataset,)
    types = {each.topic: each.type for dataset in datasets for each in dataset.topics}
    sources = {topic: kind for topic, kind in types.items() if topic in read}
    played = {each.source for each in plan.inputs if each.bag_topic}
    transforms = buffered_transforms(buffer_dir)
    if TF in transforms:
        sources[TF] = TF_TYPE
    launcher.see_to_room(plan, _PHASE)
    loader = launcher.start(next(each for each in processes if each.role == "loader"))
    launcher.configure(
        loader,
        protocol.ConfigureLoader(
            sources=sources,
            recorded=recorded,
            buffer_dir=str(buffer_dir),
            passed=tuple(sorted(played - sources.keys())),
            retime=plan.timeline is not None and plan.timeline.recorded,
            static=TF_STATIC in transforms,
        ),
    )
    others = [each for each in processes if each.role != "loader"]
    deadline = StartDeadline(plan.start_timeout_ns)
    nodes = launcher.start_nodes(others, deadline)
    children.ask(loader, protocol.Subscribe(), protocol.Matched, 10.0)
    # What is played as it was recorded, too, has perhaps no reader here: not all nodes are known.
    wanted = {
        topic: readers_wanted(plan, topic, _PHASE)
        for topic in sources
        if read.get(topic) or topic not in {*played, TF}
    }
    wanted |= dict.fromkeys(recorded, 1) | listeners(launcher, transforms)
    between = _readers_between(zip(nodes, others, strict=True), launcher, recorded)
    wait_until_matched(children, launcher, {loader: wanted} | between, plan, _PHASE, deadline)
    load = protocol.Load(
        patience_ns=plan.drain_timeout_ns, real_time=any(dataset.real_time for dataset in datasets)
    )
    loaded = children.ask(loader, load, protocol.Loaded, _LOAD_S)
    _check(plan, children, launcher, loader, loaded, buffer_dir, note)
    children.end([loader, *nodes])


def _readers_between(
    nodes: Iterable[tuple[Child, ProcessPlan]], launcher: Launcher, recorded: Iterable[str]
) -> dict[Child, dict[str, int]]:
    """For each host, how many readers its topics must find among the preprocessors and the loader.

    The loader sees its own ends of the graph only. What the first of a chain publishes before the
    second is matched would be lost.
    """
    readers = Counter(list(recorded))
    readers.update(topic for _, topic, _, does in launcher.endpoints if does == "subscribes")
    return {
        child: {
            topic: readers[topic]
            for node, topic, _, does in launcher.endpoints
            if does == "publishes" and node in {each.name for each in process.nodes}
        }
        for child, process in nodes
        if process.role == "host"
    }


def _check(
    plan: Plan,
    children: Children,
    launcher: Launcher,
    loader: Child,
    loaded: protocol.Loaded,
    buffer_dir: Path,
    note: Callable[[str], None],
) -> None:
    """Compare what came out with what went in."""
    silent = [topic for topic, count in loaded.recorded.items() if count == 0]
    fed = ", ".join(f"{topic}: {count} messages" for topic, count in loaded.published.items())
    if silent:
        facts = _watch_all(plan, children, launcher, loader, buffer_dir)
        breaks = breaks_of(facts, silent)
        also = suspicions(breaks, launcher.differences)
        raise explain(
            launcher,
            breaks,
            f"nothing arrived on {', '.join(silent)}: {told(facts, silent, breaks, also)}",
            otherwise=NoOutputError,
            hint=f"The preprocessors were fed ({fed}), but published nothing there.",
        )
    # The shortest source: whatever is made of several has no more to go by.
    sent = min(
        (count for topic, count in loaded.published.items() if count and topic != TF), default=0
    )
    for topic, count in loaded.recorded.items():
        if count < sent:
            note(f"{topic}: {count} messages came out of the preprocessors for {sent} in")


def _watch_all(
    plan: Plan, children: Children, launcher: Launcher, loader: Child, rows_dir: Path
) -> Facts:
    """Load some messages again, and see what passes on each topic."""
    eyes = launcher.start(
        ProcessPlan(name="observer", role="monitor", phase=_PHASE, argv=HARNESS_ARGV, env={})
    )
    launcher.configure(eyes, protocol.ConfigureMonitor(monitors=(), rows_dir=str(rows_dir)))

    def play() -> None:
        command = protocol.Play(rate_hz=PLAY_HZ, steps=PLAY_STEPS)
        children.ask(loader, command, protocol.Played, _PLAY_S)

    known = launcher.endpoints_in(plan, _PHASE)
    return Observer(children, eyes, plan, _PHASE, known).watch(rows_dir, play)
