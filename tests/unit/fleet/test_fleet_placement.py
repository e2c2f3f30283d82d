"""Which hosts make a run."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from example_spec import example
from r2bspec._version import __version__
from r2bspec.fleet.client import Host, place
from r2bspec.fleet.host import HostFacts
from r2bspec.language.load_spec import load_spec
from r2bspec.language.spec import Requires
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.plan import Plan
from r2bspec.plan.this_machine import MachineFacts, unmet


def host(name: str, version: str = __version__, **changes: Any) -> Host:
    usual: dict[str, Any] = {"arch": "x86_64", "cores": 4, "labels": {"robot": name}}
    return Host(name, f"tcp://{name}", HostFacts(version, MachineFacts(**(usual | changes))))


def plan(requires: Requires | None = None) -> Plan:
    loaded = load_spec(example())
    assert loaded.spec is not None
    made = compile_plan(loaded.spec, None)
    return msgspec.structs.replace(made, requires=msgspec.UNSET if requires is None else requires)


FLEET = (
    host("carter", arch="aarch64", gpus=("NVIDIA Tegra",)),
    host("desk", cores=16),
    host("old", "0.0.1"),
    Host("bare", "tcp://bare", None),
)


@pytest.mark.parametrize(
    ("requires", "wanted", "runs"),
    [
        (None, ("any",), [("", "")]),
        (None, ("all",), [("carter", ""), ("desk", "")]),
        (Requires(gpu=True), ("all",), [("carter", "")]),
        (
            Requires(gpu=True),
            ("desk", "carter", "nemo"),
            [("desk", "R2B683"), ("carter", ""), ("nemo", "R2B683")],
        ),
        (Requires(cores=99), ("any",), [("", "R2B683")]),
    ],
)
def test_a_run_is_made_on_hosts_that_fit(
    requires: Requires | None, wanted: tuple[str, ...], runs: list[tuple[str, str]]
) -> None:
    placed = place(plan(requires), wanted, FLEET)
    assert [(run.host, run.error.code if run.error else "") for run in placed] == runs


def test_hosts_of_another_version_and_without_r2bspec_make_no_run() -> None:
    (placed,) = place(plan(Requires(cores=99)), ["all"], FLEET)
    assert str(placed.error) == (
        "no host can make the run: bare: it has no r2bspec; carter: it has 4 cores, not 99; desk: "
        f"it has 16 cores, not 99; old: it has r2bspec 0.0.1, not {__version__}"
    )


@pytest.mark.parametrize(
    ("requires", "lacks"),
    [
        (Requires(), ()),
        (Requires(arch="aarch64", cores=2, ros_distro="jazzy", gpu=True), ()),
        (Requires(arch="x86_64"), ("its architecture is aarch64, not x86_64",)),
        (Requires(ros_distro="humble"), ("it has ROS jazzy, not humble",)),
        (Requires(labels={"robot": "car*"}), ()),
        (Requires(labels={"robot": "desk"}), ("its label robot is carter, not desk",)),
        (Requires(labels={"fast": True}), ("it has no label fast",)),
    ],
)
def test_requirements_are_compared_with_the_machine(
    requires: Requires, lacks: tuple[str, ...]
) -> None:
    machine = MachineFacts(
        arch="aarch64", cores=2, gpus=("x",), ros_distro="jazzy", labels={"robot": "carter"}
    )
    assert unmet(requires, machine) == lacks
