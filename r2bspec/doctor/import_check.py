"""Checking in a new interpreter which modules can be imported."""

from __future__ import annotations

import json
import subprocess
from typing import Any

from r2bspec.doctor.checkup import System

_TIMEOUT_S = 60.0


def probe_imports(system: System, *names: str) -> dict[str, dict[str, Any]]:
    """The results of `r2bspec.doctor.import_probe` for these modules; a timeout is an error."""
    command = [system.python, "-P", "-m", "r2bspec.doctor.import_probe", *names]
    try:
        done = subprocess.run(
            command,
            env=dict(system.environ),
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return {name: {"error": f"not imported within {_TIMEOUT_S:g} s"} for name in names}
    except OSError as error:
        return {name: {"error": str(error)} for name in names}
    try:
        found: dict[str, dict[str, Any]] = json.loads(done.stdout)
    except ValueError:
        # A module can end the interpreter, as rclpy does where its middleware is not installed.
        said = done.stderr.strip().splitlines() or [f"it ended with status {done.returncode}"]
        return {name: {"error": said[-1]} for name in names}
    return found
