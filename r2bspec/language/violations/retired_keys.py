"""Keys that earlier versions of the language had: what to write instead."""

from __future__ import annotations

from r2bspec.diagnostics import Path

_NATIVE_FORMAT = (
    "it is gone: messages are played and monitored in their ROS formats, in which nodes with "
    "adapted types (NITROS) communicate as well; remove it, and write 'harness: {placement: "
    "graph}' to have player and monitors in the processes of the graph"
)
_ONE_HARNESS = (
    "it is gone, because there is one harness: remove it; 'harness: {placement: graph}' puts "
    "player and monitors into the processes of the graph, as ros2_benchmark does"
)

_RETIRED: dict[tuple[str, ...], str] = {
    ("harness", "kind"): _ONE_HARNESS,
    ("harness", "data_loader"): _NATIVE_FORMAT,
    ("harness", "playback"): _NATIVE_FORMAT,
    ("harness", "monitor"): _NATIVE_FORMAT,
    ("monitors", "*", "parameters"): _NATIVE_FORMAT,
}
"""The help for each; ``*`` is any name."""


def retired_key_help(owner: Path, key: str) -> str:
    """What to do with a key that the map at `owner` once had; empty if it never had it."""
    place = (*owner, key)
    for pattern, help_text in _RETIRED.items():
        if len(pattern) == len(place) and all(
            expected in ("*", word) for expected, word in zip(pattern, place, strict=True)
        ):
            return help_text
    return ""
