"""``make demo`` fails where the demo fails, and not where a busy machine leaves something open."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

MAKE = shutil.which("make") or ""

pytestmark = pytest.mark.skipif(not MAKE, reason="make is not installed")


@pytest.mark.parametrize(("status", "succeeds"), [(0, True), (1, False), (3, True), (4, False)])
def test_only_what_is_open_is_no_failure(tmp_path: Path, status: int, succeeds: bool) -> None:
    program = tmp_path / "r2bspec"
    program.write_text(f"#!/bin/sh\necho ran $*\nexit {status}\n")
    program.chmod(0o755)
    done = subprocess.run(
        # What it installs is left as it is.
        [MAKE, "--old-file=install", f"BIN={tmp_path}", "demo"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "ran run specs/apriltag_node.r2b.yaml" in done.stdout
    assert (done.returncode == 0) == succeeds
    assert ("that is no failure" in done.stdout) == (status == 3)
