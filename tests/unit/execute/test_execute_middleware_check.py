"""Whether a run is refused whose middleware cannot be configured for the transport of its plan."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import msgspec
import pytest

from command_line import Call
from example_spec import example
from plans import process_plan
from r2bspec import api
from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.errors import MiddlewareError
from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.prerequisites import check_middleware
from r2bspec.ipc import protocol
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.plan import Plan
from r2bspec.record.run_folder import open_run
from run_simulation import Simulation

CYCLONE = {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}


def plan(transport: Any, env: dict[str, str] | None = None) -> Plan:
    """A plan with one node, in whose environment `env` is."""
    process = process_plan("relay", "host", env=env or {})
    return msgspec.structs.replace(Simulation().plan(), transport=transport, processes=(process,))


@pytest.mark.parametrize("transport", ["shared_memory", "udp"])
def test_a_transport_of_another_middleware_is_refused_with_the_code_of_the_rule(
    transport: str,
) -> None:
    with pytest.raises(MiddlewareError) as caught:
        check_middleware(plan(transport), CYCLONE)
    error = caught.value
    assert (error.code, error.exit_code) == ("R2B666", 2)
    assert str(error) == (
        f"'transport: {transport}' cannot be configured with rmw_cyclonedds_cpp, which "
        "RMW_IMPLEMENTATION selects"
    )
    assert error.hint.startswith("Write 'transport: inherit'")


def test_a_plan_file_is_refused_before_anything_is_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    spec = tmp_path / "relay.r2b.yaml"
    spec.write_text(example())
    (tmp_path / "plan.json").write_bytes(canonical_json(api.compile_plan(spec)))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RMW_IMPLEMENTATION", CYCLONE["RMW_IMPLEMENTATION"])
    said = call("run", "plan.json", "--output", "run", status=2).err
    assert "R2B666" in said
    assert "cannot be configured with rmw_cyclonedds_cpp" in said
    record = open_run(tmp_path / "run").record
    assert record.processes == ()
    assert record.versions["rmw"] == "rmw_cyclonedds_cpp"


class _Loaded:
    """Stands for processes: each that is asked says which middleware it has loaded, or nothing."""

    def __init__(self, *rmw: str) -> None:
        self._rmw = iter(rmw)

    def send(self, _: object) -> None:
        pass

    def answer(self, *_: object) -> protocol.Ready:
        return protocol.Ready(rmw=next(self._rmw))


def configured(tmp_path: Path, transport: str, *loaded: str) -> list[str]:
    """The middleware that a launcher knows of after each process that it has configured."""
    environment = RunEnvironment(
        plan(transport), run_id="r", domain=1, scratch=tmp_path, largest_message_bytes=1
    )
    processes: Any = _Loaded(*loaded)
    launcher = Launcher(processes, environment, cast("Any", None), tmp_path)
    known = []
    for _ in loaded:
        launcher.configure(processes, None)
        known.append(launcher.rmw)
    return known


def test_an_installation_that_loads_another_one_than_ros_usually_does_is_refused(
    tmp_path: Path,
) -> None:
    refused = "rmw_cyclonedds_cpp, which this installation selects"
    with pytest.raises(MiddlewareError, match=refused):
        configured(tmp_path, "udp", "rmw_cyclonedds_cpp")
    assert configured(tmp_path, "inherit", "rmw_cyclonedds_cpp") == ["rmw_cyclonedds_cpp"]
    # Processes that do not say it change nothing.
    said = configured(tmp_path, "udp", "", "rmw_fastrtps_cpp", "")
    assert said == ["", "rmw_fastrtps_cpp", "rmw_fastrtps_cpp"]
