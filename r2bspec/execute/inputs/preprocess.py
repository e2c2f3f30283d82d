"""The preprocess phase: the preprocessors process the recorded messages; their output is buffered.

The preprocessors are ended before the measurement, so that they take no CPU time from the graph
under test.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from r2bspec.execute.bringup.graph_matching import (
    expected_subscriptions,
    graph_error,
    graph_observer,
    subscription_counts,
    wait_until_matched,
)
from r2bspec.execute.bringup.launcher import Launcher, message_packages
from r2bspec.execute.bringup.readiness import StartDeadline
from r2bspec.execute.bringup.spec_mismatches import check_parameters, related_differences
from r2bspec.execute.diagnosis.find_fault import fault_report, find_faults
from r2bspec.execute.diagnosis.observe_graph import (
    TRACE_RATE_HZ,
    TRACE_STEPS,
    GraphFacts,
)
from r2bspec.execute.errors import NoOutputError
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.buffers import TF, TF_STATIC, TF_TYPE, buffered_transforms
from r2bspec.plan.command_lines import NATIVE_ARGV
from r2bspec.plan.plan import Plan, ProcessPlan

_PHASE: Final = "preprocess"
_LOAD_TIMEOUT_S = 3600.0
_PLAY_TIMEOUT_S = 60.0


def preprocess(
    plan: Plan,
    supervisor: ProcessSupervisor,
    launcher: Launcher,
    buffer_dir: Path,
    note: Callable[[str], None],
) -> None:
    """Run the preprocessors on all messages that were buffered from the bag.

    Raises:
        NoOutputError: a recorded topic has no messages.
        RunError: a process exited, failed, or was not ready in time.
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
    launcher.check_shared_memory(plan, _PHASE)
    launcher.start_early(processes, message_packages(plan), observer=False)
    loader = launcher.start(next(each for each in processes if each.role == "loader"))
    launcher.configure(
        loader,
        protocol.ConfigureLoader(
            sources=sources,
            recorded=recorded,
            buffer_dir=str(buffer_dir),
            buffer_only=tuple(sorted(played - sources.keys())),
            retime=plan.timeline is not None and plan.timeline.recorded,
            static=TF_STATIC in transforms,
            clock=plan.clock,
        ),
    )
    others = [each for each in processes if each.role != "loader"]
    deadline = StartDeadline(plan.start_timeout_ns)
    nodes = launcher.start_nodes(others, deadline)
    supervisor.request(loader, protocol.Subscribe(), protocol.Matched, 10.0)
    # An input that is also played as recorded may have no subscription here.
    wanted = {
        topic: expected_subscriptions(plan, topic, _PHASE)
        for topic in sources
        if read.get(topic) or topic not in {*played, TF}
    }
    wanted |= dict.fromkeys(recorded, 1) | subscription_counts(launcher, transforms)
    between = _expected_subscriptions_by_host(zip(nodes, others, strict=True), launcher, recorded)
    wait_until_matched(
        supervisor, launcher, {loader: wanted} | between, plan, _PHASE, deadline, note
    )
    check_parameters(plan, _PHASE, supervisor, loader, launcher.differences, note)
    load = protocol.Load(
        max_output_gap_ns=plan.drain_timeout_ns,
        real_time=any(dataset.real_time for dataset in datasets),
    )
    loaded = supervisor.request(loader, load, protocol.Loaded, _LOAD_TIMEOUT_S)
    _check_outputs(plan, supervisor, launcher, loader, loaded, buffer_dir, note)
    supervisor.end([loader, *nodes])


def _expected_subscriptions_by_host(
    nodes: Iterable[tuple[ManagedProcess, ProcessPlan]], launcher: Launcher, recorded: Iterable[str]
) -> dict[ManagedProcess, dict[str, int]]:
    """For each host, how many subscriptions of preprocessors and loader its topics must match.

    The loader counts its own endpoints only. Messages that the first preprocessor of a chain
    publishes before the second one is matched would be lost.
    """
    subscriptions = Counter(list(recorded))
    subscriptions.update(topic for _, topic, _, does in launcher.endpoints if does == "subscribes")
    return {
        child: {
            topic: subscriptions[topic]
            for node, topic, _, does in launcher.endpoints
            if does == "publishes" and node in {each.name for each in process.nodes}
        }
        for child, process in nodes
        if process.role == "host"
    }


def _check_outputs(
    plan: Plan,
    supervisor: ProcessSupervisor,
    launcher: Launcher,
    loader: ManagedProcess,
    loaded: protocol.Loaded,
    buffer_dir: Path,
    note: Callable[[str], None],
) -> None:
    """Compare the number of output messages with the number of input messages."""
    silent = [topic for topic, count in loaded.recorded.items() if count == 0]
    published = ", ".join(f"{topic}: {count} messages" for topic, count in loaded.published.items())
    if silent:
        facts = _trace_messages(plan, supervisor, launcher, loader, buffer_dir)
        faults = find_faults(facts, silent)
        also = related_differences(faults, launcher.differences)
        raise graph_error(
            launcher,
            faults,
            f"no messages on {', '.join(silent)}",
            fault_report(facts, silent, faults, also),
            otherwise=NoOutputError,
            hint=f"The loader published the input of the preprocessors ({published}).",
        )
    # An output made from several inputs has at most as many messages as the shortest one.
    sent = min(
        (count for topic, count in loaded.published.items() if count and topic != TF), default=0
    )
    for topic, count in loaded.recorded.items():
        if count < sent:
            note(f"{topic}: the preprocessors published {count} messages for {sent} inputs")


def _trace_messages(
    plan: Plan,
    supervisor: ProcessSupervisor,
    launcher: Launcher,
    loader: ManagedProcess,
    rows_dir: Path,
) -> GraphFacts:
    """Publish some messages again, and count the messages on each topic."""
    monitor = launcher.start(
        ProcessPlan(name="monitor", role="monitor", phase=_PHASE, argv=NATIVE_ARGV, env={})
    )
    launcher.configure(monitor, protocol.ConfigureMonitor(monitors=(), rows_dir=str(rows_dir)))

    def play() -> None:
        command = protocol.Play(rate_hz=TRACE_RATE_HZ, steps=TRACE_STEPS)
        supervisor.request(loader, command, protocol.Played, _PLAY_TIMEOUT_S)

    return graph_observer(supervisor, launcher, plan, _PHASE, monitor).trace(rows_dir, play)
