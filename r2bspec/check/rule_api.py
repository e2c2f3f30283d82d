"""The names that most rules import: context, findings, subjects, and parts of messages."""

from __future__ import annotations

from r2bspec.check.check_context import Context
from r2bspec.check.finding import Finding, Findings, Pointer
from r2bspec.check.message_text import MAX_SUGGESTIONS, pluralize, quoted_list, suggestion
from r2bspec.check.requirement_metrics import KnownMetric, known_metrics, max_wrong_share
from r2bspec.check.rule import Rule
from r2bspec.check.suppression_keys import (
    MEASURE_FLOW,
    PREPROCESS_FLOW,
    flow_key,
    topic_key,
    value_key,
)
from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import quote
from r2bspec.wiring.wiring import Endpoint, NodeWiring, PhaseWiring

__all__ = [
    "MAX_SUGGESTIONS",
    "MEASURE_FLOW",
    "PREPROCESS_FLOW",
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
    "did_you_mean",
    "flow_key",
    "known_metrics",
    "max_wrong_share",
    "pluralize",
    "quote",
    "quoted_list",
    "suggestion",
    "topic_key",
    "value_key",
]
