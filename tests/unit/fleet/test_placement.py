"""Which hosts make a run."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from example_spec import example
from r2bspec._version import __version__
from r2bspec.fleet.hosts import HostFacts, place
from r2bspec.language.load_spec import load_spec
from r2bspec.language.spec import Requires
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.plan import Plan
from r2bspec.plan.this_machine import MachineFacts, unmet


def facts(name: str, **changes: Any) -> HostFacts:
    usual: dict[str, Any] = {
        "arch": "x86_64",
        "cores": 4,
        "ros_distro": "jazzy",
        "labels": {"robot": name},
        "r2bspec": __version__,
    }
    return HostFacts(name=name, **(usual | changes))


def plan(requires: Requires | None = None) -> Plan:
    loaded = load_spec(example())
    assert loaded.spec is not None
    made = compile_plan(loaded.spec, None)
    return msgspec.structs.replace(made, requires=msgspec.UNSET if requires is None else requires)


FLEET = {
    "carter": facts("carter", arch="aarch64", gpus=("NVIDIA Tegra",)),
    "desk": facts("desk", cores=16),
    "old": facts("old", r2bspec="0.0.1"),
}


def placed(requires: Requires | None, *wanted: str, **more: Any) -> list[tuple[str, set[str], str]]:
    found = place(plan(requires), FLEET, wanted, **more)
    return [(each.host, set(each.hosts), each.error.code if each.error else "") for each in found]


def test_a_run_on_all_hosts_is_one_on_each_that_fits() -> None:
    assert placed(None, "all") == [
        ("carter", {"carter"}, ""),
        ("desk", {"desk"}, ""),
        ("old", set(), "R2B684"),
    ]
    assert placed(Requires(gpu=True), "all") == [("carter", {"carter"}, "")]


def test_a_run_on_any_host_may_be_made_by_those_that_fit() -> None:
    assert placed(None, "any") == [("", {"carter", "desk"}, "")]
    assert placed(Requires(cores=8), "any") == [("", {"desk"}, "")]
    assert placed(Requires(labels={"robot": "old"}), "any") == [("", set(), "R2B684")]


@pytest.mark.parametrize("wanted", ["all", "any"])
def test_what_no_host_fits_is_said_with_what_each_lacks(wanted: str) -> None:
    (found,) = place(plan(Requires(cores=99)), FLEET, [wanted])
    assert found.error is not None
    assert found.error.code == "R2B683"
    assert "desk: it has 16 cores, not 99" in str(found.error)
    assert "carter: it has 4 cores" in str(found.error)


def test_named_hosts_must_be_there_and_fit() -> None:
    assert placed(Requires(gpu=True), "desk", "carter", "nemo") == [
        ("desk", set(), "R2B683"),
        ("carter", {"carter"}, ""),
        ("nemo", set(), "R2B683"),
    ]
    assert placed(None, "nemo", expected=["nemo"]) == [("nemo", {"nemo"}, "")]
    assert ("nemo", {"nemo"}, "") in placed(None, "all", expected=["nemo", "desk"])


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
        (Requires(cores=2), ()),
    ],
)
def test_requirements_are_compared_with_the_machine(
    requires: Requires, lacks: tuple[str, ...]
) -> None:
    machine = MachineFacts(
        arch="aarch64", cores=2, gpus=("x",), ros_distro="jazzy", labels={"robot": "carter"}
    )
    assert unmet(requires, machine) == lacks
