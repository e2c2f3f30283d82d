"""All that most rules need, under one import: what a rule is, what it looks at, and its words."""

from __future__ import annotations

from r2bspec.check import suppression_keys
from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding, Findings, Pointer
from r2bspec.check.message_text import MAX_SUGGESTIONS, pluralize, quoted_list, suggestion
from r2bspec.check.requirement_metrics import KnownMetric, known_metrics
from r2bspec.check.rule import Rule
from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.diagnostic import Certainty, Path, Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.wiring.wiring import Endpoint, NodeWiring, PhaseWiring

__all__ = [
    "MAX_SUGGESTIONS",
    "Certainty",
    "Context",
    "Endpoint",
    "Finding",
    "Findings",
    "KnownMetric",
    "NodeWiring",
    "Path",
    "PhaseWiring",
    "Pointer",
    "Rule",
    "Severity",
    "did_you_mean",
    "example",
    "known_metrics",
    "pluralize",
    "quote",
    "quoted_list",
    "suggestion",
    "suppression_keys",
]
