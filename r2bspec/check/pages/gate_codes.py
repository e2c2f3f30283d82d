"""R2B692 and R2B693: gates that are weaker than their base, or that nothing can fail."""

from __future__ import annotations

from r2bspec.check.example_spec import example
from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity

GATE_PAGES = (
    Page(
        slug="weaker-gate",
        code="R2B692",
        title="gate is weaker than that of the base",
        severity=Severity.ERROR,
        why=(
            "Whoever changes a node can change the spec that judges it. A comparison with a base "
            "therefore compares everything that the verdict depends on: objectives, monitors, "
            "inputs, data, durations, waivers and the existence of the spec. What is weaker, or "
            "differs in a way that may be, is an error at its line, unless the pipeline allows it "
            "by the name in the message, as in --allow 'objective fast'. The example fails where "
            "its base has the passing one; docs/gate.md lists the names."
        ),
        failing=example(slos="fast: {at: 30 Hz, require: [latency.p90 < 50 ms]}"),
        passing=example(slos="fast: {at: 30 Hz, require: [latency.p90 < 30 ms]}"),
    ),
    Page(
        slug="missing-objectives",
        code="R2B693",
        title="no objective can fail the run",
        severity=Severity.ERROR,
        why=(
            "A run without an active objective of level error passes whatever it measures, so with "
            "--require-slos it is refused. An objective is active if its 'when' is true. Add a "
            "requirement, or leave out --require-slos where a run only measures."
        ),
        failing=example(slos="fast: {at: 30 Hz, level: warn, require: [latency.p90 < 50 ms]}"),
        passing=example(slos="fast: {at: 30 Hz, require: [latency.p90 < 50 ms]}"),
    ),
)
