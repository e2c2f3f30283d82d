"""Keys of the subjects of findings, which link consequences to their cause.

See `r2bspec.check.engine` for their use.
"""

from __future__ import annotations

from r2bspec.diagnostics.diagnostic import Path

MEASURE_FLOW = "flow"
"""The path of the messages from the playback inputs to the monitors."""

PREPROCESS_FLOW = "feed"
"""The path of the messages from the bag through the preprocessors to the playback inputs."""


def flow_key(phase: str) -> str:
    """The path of the messages in a phase."""
    return PREPROCESS_FLOW if phase == "preprocess" else MEASURE_FLOW


def topic_key(phase: str, name: str) -> str:
    """The publishers and subscriptions of a topic, by its full name."""
    return f"topic:{phase}:{name}"


def value_key(path: Path) -> str:
    """A value of the document."""
    return f"value:{'.'.join(map(str, path))}"
