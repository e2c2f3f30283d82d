"""The setup steps of a plan, its readiness probes, and the steps after the graph is ready."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.language.spec import Spec
from r2bspec.plan.plan import AfterReadyPlan, ProbePlan, SetupPlan
from r2bspec.wiring.build_wiring import harness_topic


def plan_setup(spec: Spec) -> tuple[SetupPlan, ...]:
    """The setup steps, in the order of the spec."""
    return tuple(
        SetupPlan(
            name=name,
            argv=step.command,
            creates=step.creates,
            directory=step.directory,
            env=step.env,
            timeout_ns=step.timeout.ns,
        )
        for name, step in spec.setup.items()
    )


def plan_ready(spec: Spec, namespace: str) -> tuple[ProbePlan, ...]:
    """The readiness probes, in the order of the spec."""
    return tuple(_probes(spec, namespace))


def _probes(spec: Spec, namespace: str) -> Iterator[ProbePlan]:
    for name, probe in spec.ready.items():
        timeout_ns = probe.timeout.ns
        if probe.log is not None:
            yield ProbePlan(
                name=name,
                kind="log",
                target=probe.log.process,
                pattern=probe.log.pattern,
                timeout_ns=timeout_ns,
            )
        elif probe.file:
            yield ProbePlan(name=name, kind="file", target=probe.file, timeout_ns=timeout_ns)
        elif probe.service:
            service = harness_topic(probe.service, namespace)
            yield ProbePlan(name=name, kind="service", target=service, timeout_ns=timeout_ns)
        elif probe.topic:
            topic = harness_topic(probe.topic, namespace)
            yield ProbePlan(name=name, kind="topic", target=topic, timeout_ns=timeout_ns)


def plan_after_ready(spec: Spec, namespace: str) -> tuple[AfterReadyPlan, ...]:
    """The `after_ready` steps, in the order of the spec."""
    return tuple(
        AfterReadyPlan(
            name=name,
            argv=step.command,
            service=harness_topic(step.service.name, namespace) if step.service else "",
            service_type=step.service.type if step.service else "",
            request=step.service.request if step.service else {},
            timeout_ns=step.timeout.ns,
        )
        for name, step in spec.after_ready.items()
    )
