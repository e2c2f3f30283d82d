"""Names of what findings are about, by which consequences find their cause.

See `r2bspec.check.engine` for what is done with them.
"""

from __future__ import annotations

from r2bspec.diagnostics.diagnostic import Path

MEASURE_FLOW = "flow"
"""Whether messages get from the playback inputs to the monitors."""

PREPROCESS_FLOW = "feed"
"""Whether messages get from the bag through the preprocessors to the playback inputs."""


def flow_key(phase: str) -> str:
    """The way of the messages in a phase."""
    return PREPROCESS_FLOW if phase == "preprocess" else MEASURE_FLOW


def topic_key(phase: str, name: str) -> str:
    """Who writes and who reads a topic, by its full name."""
    return f"topic:{phase}:{name}"


def value_key(path: Path) -> str:
    """Whether a value of the document is right."""
    return f"value:{'.'.join(map(str, path))}"
