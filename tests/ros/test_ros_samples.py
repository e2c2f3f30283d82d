"""What is judged while a run goes on is what its folder says afterwards, number by number."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import msgspec
import numpy as np
import pytest

pytest.importorskip("rclpy")

from r2bspec import api
from r2bspec.execute import controller
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.record.run_folder import open_run
from ros_runs import IMAGE, Bench, relay_node, relay_spec
from ros_runs import bench as bench


def test_samples_in_memory_are_those_of_the_run_folder(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    held: list[RunSamples] = []
    collect = controller._Run._samples_so_far

    def collected(self: Any) -> RunSamples:
        held.append(collect(self))
        return held[-1]

    monkeypatch.setattr(controller._Run, "_samples_so_far", collected)
    spec = relay_spec(
        graph={
            "nodes": {
                "first": relay_node(remappings={"output": "between"}),
                "second": relay_node(remappings={"input": "between"}),
            }
        },
        monitors={"out": {"topic": "output", "format": IMAGE}},
        slos={"answers": {"at": "20 Hz", "require": ["received > 0"]}},
    )
    spec["benchmark"] |= {"iterations": 3, "gate": {"confirm": False, "interference": "tolerate"}}
    path = bench.write(spec, f"samples-{secrets.token_hex(2)}")
    folder = bench.folder / "in-process"
    api.run(api.prepare(path), folder)
    read = read_samples(open_run(folder))
    last = held[-1]
    assert last.monitors == read.monitors
    assert list(last.iterations) == list(read.iterations) == [20.0]
    for one, other in zip(last.iterations[20.0], read.iterations[20.0], strict=True):
        assert one.segment == other.segment
        assert [*values(one.monitors)] == [*values(other.monitors)]
        assert [*values(one.playback)] == [*values(other.playback)]


def values(what: Any) -> Iterator[Any]:
    """All numbers of nested samples, in the order of their fields."""
    if isinstance(what, np.ndarray):
        yield what.tolist()
    elif isinstance(what, dict):
        for key, value in what.items():
            yield key
            yield from values(value)
    elif isinstance(what, tuple):
        for value in what:
            yield from values(value)
    elif hasattr(what, "__dataclass_fields__"):
        for field in fields(what):
            yield from values(getattr(what, field.name))
    elif isinstance(what, msgspec.Struct):
        yield msgspec.to_builtins(what)
    else:
        yield what
