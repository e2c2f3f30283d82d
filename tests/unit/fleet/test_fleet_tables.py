"""The tables of ``r2bspec fleet`` where there is no terminal."""

from __future__ import annotations

from typing import Any

import pytest
from click.testing import CliRunner

from r2bspec.cli import fleet
from r2bspec.fleet.hosts import Host, HostFacts
from r2bspec.fleet.messages import HostState


def test_the_table_of_hosts_is_whole_in_a_pipe(monkeypatch: pytest.MonkeyPatch) -> None:
    labels = {"robot": "carter", "place": "the laboratory at the end of the long corridor"}
    facts = HostFacts(
        name="a-host-with-a-long-name.example",
        arch="x86_64",
        cpu="AMD EPYC 9354 32-Core Processor",
        cores=64,
        gpus=("NVIDIA RTX 6000 Ada Generation",),
        labels=labels,
        allows=("commands", "python"),
    )
    hosts: Any = lambda *_: [Host("tcp://127.0.0.1:1", facts, HostState())]  # noqa: E731
    monkeypatch.setattr(fleet, "_hosts_of", hosts)
    for verb in ("hosts", "status"):
        shown = CliRunner().invoke(fleet.command, [verb, "tcp://127.0.0.1"]).output
        assert "…" not in shown
        assert facts.name in shown
        assert len(shown.splitlines()) == 2
    shown = CliRunner().invoke(fleet.command, ["hosts", "tcp://127.0.0.1"]).output
    for text in (facts.cpu, *facts.gpus, *labels.values(), "commands python", "r2bspec"):
        assert text in shown
