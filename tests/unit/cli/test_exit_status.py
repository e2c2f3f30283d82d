"""One mistake has one exit status: of the process, in its result, and when the run is judged."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from command_line import Call
from nightly import sampled
from r2bspec.errors import R2bspecError
from r2bspec.execute import controller, errors
from r2bspec.record.run_record import Difference

LIVE = """\
r2bspec: 1
name: status
playback: {mode: live}
graph: {nodes: {n: {command: [sh]}}}
monitors: {out: {topic: /out, format: sensor_msgs/msg/Image}}
benchmark: {duration: 1 s}
slos: {s: {require: [out.latency.mean < 1 s]}}
"""


def kinds_of(kind: type[errors.RunError]) -> Iterator[type[errors.RunError]]:
    yield kind
    for below in kind.__subclasses__():
        yield from kinds_of(below)


def example_of(kind: type[errors.RunError]) -> R2bspecError:
    if issubclass(kind, errors.GraphDifferencesError):
        return kind(
            [
                Difference(
                    code="R2B644", message="differs", part="node", owner="n", name="", topic=""
                )
            ]
        )
    return kind("it failed")


ERRORS = [
    *map(example_of, sorted(set(kinds_of(errors.RunError)), key=lambda kind: kind.__name__)),
    *(errors.RunError("it failed", code=code) for code in sorted(errors._CERTAIN_CODES)),
]


@pytest.mark.parametrize(
    "error", sampled(ERRORS, 8), ids=lambda error: f"{type(error).__name__}-{error.code}"
)
def test_the_result_says_what_the_process_ended_with(
    error: R2bspecError, call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: object) -> None:
        raise error

    monkeypatch.setattr(controller._Run, "_pass_states", fails)
    spec, folder = tmp_path / "a.r2b.yaml", tmp_path / "out"
    spec.write_text(LIVE)
    status = call("run", spec, "--output", folder, "--no-lock").status
    assert status == error.exit_code
    verdict = json.loads((folder / "result.json").read_bytes())["verdict"]
    assert verdict["exit_code"] == status
    assert call("judge", folder).status == status
