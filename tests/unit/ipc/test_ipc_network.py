"""Promise: the network of a run is a namespace of its own, or the run says what is missing."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from r2bspec.ipc.network import NetworkError, NetworkNamespace, netem_arguments, why_not_emulated
from r2bspec.language.quantities import Duration, Share, Size
from r2bspec.language.spec import Network

SLOW = Network(delay=Duration(5_500_000), jitter=Duration(250), loss=Share(0.01), rate=Size(12_000))
REFUSED = why_not_emulated()
MAY_MAKE = REFUSED is None or "sch_netem" in str(REFUSED)
makes = pytest.mark.skipif(not MAY_MAKE, reason=str(REFUSED))


def play_tc(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """Have another tc."""
    (folder / "tc").write_text(f"#!/bin/sh\n{script}\n")
    (folder / "tc").chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")


@pytest.mark.parametrize(
    ("network", "words"),
    [
        (Network(), ""),
        (SLOW, " delay 5500.000us 0.250us loss 1% rate 96000bit"),
        (Network(delay=Duration(10**9)), " delay 1000000.000us 0.000us"),
    ],
    ids=str,
)
def test_tc_is_told_what_the_spec_says(network: Network, words: str) -> None:
    assert " ".join(netem_arguments(network)) == f"limit 100000{words}"


@makes
def test_a_process_with_the_prefix_has_the_loopback_of_the_run_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play_tc(tmp_path, monkeypatch, f'echo "$@" > {tmp_path}/said')
    namespace = NetworkNamespace(SLOW)
    command = [*namespace.prefix, "ip", "-o", "link"]
    links = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert (tmp_path / "said").read_text().startswith("qdisc add dev lo root netem limit 100000")
    assert links.count("\n") == 1
    assert "mtu 1500" in links
    assert "LOWER_UP" in links
    namespace.close()
    # Nothing but its processes has kept it.
    assert subprocess.run(command, capture_output=True, check=False).returncode != 0


@pytest.mark.skipif(REFUSED is not None, reason=str(REFUSED))
def test_packets_are_delayed() -> None:
    namespace = NetworkNamespace(Network(delay=Duration(10_000_000)))
    shown = subprocess.run(
        [*namespace.prefix, shutil.which("tc") or "tc", "qdisc", "show", "dev", "lo"],
        capture_output=True,
        text=True,
        check=True,
    )
    namespace.close()
    assert "delay 10" in shown.stdout


UNSHARE_FAILS = "unshare: unshare failed: Operation not permitted"


@pytest.mark.parametrize(
    ("program", "script", "message", "hint"),
    [
        ("unshare", f"echo {UNSHARE_FAILS!r} >&2; exit 1", "namespace is not permitted", "root"),
        ("tc", "echo Error: Specified qdisc kind is unknown. >&2; exit 2", "no sch_netem", "mod"),
        ("tc", "echo RTNETLINK answers: Operation not permitted >&2; exit 2", "not permitted", "N"),
    ],
)
def test_a_refusal_names_what_is_missing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    program: str,
    script: str,
    message: str,
    hint: str,
) -> None:
    if program == "tc" and not MAY_MAKE:
        pytest.skip(str(REFUSED))
    play_tc(tmp_path, monkeypatch, script)
    (tmp_path / "tc").rename(tmp_path / program)
    with pytest.raises(NetworkError, match=message) as raised:
        NetworkNamespace(SLOW)
    assert hint in raised.value.hint
    assert raised.value.code == "R2B421"


def test_a_missing_program_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {name: f"/bin/{name}" for name in ("unshare", "nsenter", "ip")}
    monkeypatch.setattr(shutil, "which", lambda name, **_: found.get(name))
    with pytest.raises(NetworkError, match="the program tc is missing") as raised:
        NetworkNamespace(SLOW)
    assert "iproute2" in raised.value.hint
