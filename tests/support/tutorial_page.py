"""The files that docs/tutorial.md shows, and how its spec is written with what editors offer."""

from __future__ import annotations

import re
import runpy
from collections.abc import Iterator
from pathlib import Path

import pytest

from page_blocks import page_blocks

_KEYS = """\
«r2bspec»«1»
«name»stereo_brightness
«data_loader»«bag»«./drive»
  «topics»«/left/image_raw»recorded/left
    «/right/image_raw»recorded/right
«playback»«pairing»«slop»10 «ms»
  «inputs»«left/image_raw»«recorded/left»⇥«sensor_msgs/msg/Image»
    «right/image_raw»«recorded/right»⇥«sensor_msgs/msg/Image»
«graph»«nodes»brightness:
      «python»«./stereo_brightness.py:StereoBrightness»
«monitors»«a monitor»brightness⇥«brightness»⇥«geometry_msgs/msg/PointStamped»
«benchmark»«rates»[20 «Hz»]
  «duration»1500 «ms»
  «iterations»4
«slos»«an objective»keeps_up⇥«20 Hz»⇥«latency.p90» «<» 200 «ms»
      - «drop_rate» «<=» 5 «%»"""
"""What is accepted is in «», ⇥ goes to the next stop of a snippet, and the rest is typed."""

_STEP = re.compile(r"«(?P<accept>[^»]*)»|(?P<next_stop>⇥)|(?P<line>\n[ -]*)|(?P<type>[^«⇥\n]+)")


def page_files() -> dict[str, str]:
    """The content of each file by its name."""
    blocks = page_blocks("tutorial.md")
    return {block.argument: block.text for block in blocks if block.kind == "file"}


def write_robot(folder: Path) -> None:
    """What the user of the tutorial has: the node, and the recording."""
    for name in ("stereo_brightness.py", "make_drive.py"):
        (folder / name).write_text(page_files()[name])
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        runpy.run_path("make_drive.py")


def steps() -> Iterator[tuple[str, str]]:
    """Each key press or choice: ``accept``, ``next_stop``, ``line`` or ``type``, with its text."""
    for match in _STEP.finditer(_KEYS):
        assert match.lastgroup is not None
        yield match.lastgroup, match[match.lastgroup]
