"""Builds the VS Code extension in a folder of its own, with what npm has."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

EXTENSION = Path(__file__).parents[2] / "editors" / "vscode"
_NOT_SOURCES = ("node_modules", "out", "dist", "*.vsix")


def installed_copy(folder: Path) -> Path:
    """A copy of the extension with its dependencies installed; skips the test without them."""
    if os.environ.get("R2BSPEC_TEST_EDITORS") != "1":
        pytest.skip("it takes a minute and packages of npm: set R2BSPEC_TEST_EDITORS=1")
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed")
    copy = folder / "vscode"
    shutil.copytree(EXTENSION, copy, ignore=shutil.ignore_patterns(*_NOT_SOURCES))
    installed = npm(copy, "ci", "--prefer-offline", "--no-audit")
    if installed.returncode and any(
        each in installed.stderr for each in ("ENOTFOUND", "EAI_AGAIN", "ECONNREFUSED", "ETIMEDOUT")
    ):
        pytest.skip("the registry of npm is not reached")
    assert installed.returncode == 0, installed.stderr
    return copy


def npm(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run npm in a folder."""
    return subprocess.run(
        ["npm", *words],  # noqa: S607 - of the path, as its user has it
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )


def packaged(folder: Path) -> Path:
    """The extension as a file that an editor installs."""
    copy = installed_copy(folder)
    made = npm(copy, "run", "package")
    assert made.returncode == 0, made.stdout + made.stderr
    return copy / "r2bspec.vsix"
