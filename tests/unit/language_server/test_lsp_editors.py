"""The language server in Neovim, without a screen."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SESSION = Path(__file__).with_name("neovim_session.lua")
SPEC = """\
r2bspec: 1
name: relay
playback:
  mode: Looping
  inputs:
    input: {from: camera/image, format: sensor_msgs/msg/Image}
data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: camera/image}}
graph: {nodes: {relay: {python: r2bspec.nodes.RelayNode}}}
monitors: {copies: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {rates: [10 Hz]}
"""


NEOVIM = shutil.which("nvim") or ""


@pytest.mark.skipif(not NEOVIM, reason="Neovim is not installed")
def test_a_session_in_neovim(tmp_path: Path) -> None:
    spec = tmp_path / "relay.r2b.yaml"
    spec.write_text(SPEC)
    environment = os.environ | {
        "R2BSPEC_LSP": f"{sys.executable} -m r2bspec lsp",
        "HOME": str(tmp_path),
    }
    done = subprocess.run(
        [NEOVIM, "--headless", "-u", "NONE", "-S", str(SESSION), str(spec)],
        check=False,
        capture_output=True,
        text=True,
        env=environment,
        timeout=250,
    )
    said = dict(line.split(": ", 1) for line in done.stdout.splitlines() if ": " in line)
    assert done.returncode == 0, (done.stdout, done.stderr)
    assert said["finding"].startswith("R2B104 unknown choice 'Looping'")
    assert said["mended"] == "0"
    assert said["completion"] == "live looping sweeping timeline"
    assert "playback.mode" in said["hover"]
    assert spec.read_text() == SPEC
