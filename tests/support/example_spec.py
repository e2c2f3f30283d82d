"""Complete specs, of which a test gives only a part."""

from __future__ import annotations

import textwrap

_SECTIONS = {
    "data_loader": "data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: image_raw}}",
    "preprocessors": "",
    "playback": "playback: {inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}}",
    "graph": (
        "graph:\n  nodes:\n    relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}"
    ),
    "monitors": "monitors: {output: {topic: output, format: sensor_msgs/msg/Image}}",
    "benchmark": "benchmark: {rates: [30 Hz]}",
    "slos": "",
}


def example(name: str = "example", **sections: str) -> str:
    """A complete spec that relays an image at 30 Hz, with some sections replaced.

    Args:
        name: of the benchmark.
        sections: text of a top-level section without its key, with any indentation; keys such as
            `environment`, `namespace` and `variables` are put at the beginning.
    """
    lines = ["r2bspec: 1", f"name: {name}"]
    head = [key for key in sections if key not in _SECTIONS]
    for key in (*head, *_SECTIONS):
        if key in sections:
            lines.append(_section(key, sections[key]))
        elif _SECTIONS[key]:
            lines.append(_SECTIONS[key])
    return "\n".join(lines) + "\n"


def _section(key: str, text: str) -> str:
    body = textwrap.dedent(text).strip("\n")
    if "\n" not in body and not body.lstrip().startswith("-") and ": " not in body.split("{")[0]:
        return f"{key}: {body.strip()}"
    return f"{key}:\n{textwrap.indent(body, '  ')}"
