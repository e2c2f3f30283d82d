"""A copy of the package in which a test makes a change, to see what else it takes."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


class EditedPackage:
    """A copy of r2bspec in a folder; `changed` are the files that were edited or added in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.changed: set[str] = set()
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "r2bspec", folder / "r2bspec", ignore=ignored)

    def edit(self, name: str, *replacements: tuple[str, str]) -> None:
        """Replace texts of a file, each of which is in it once."""
        file = self.folder / name
        source = file.read_text(encoding="utf-8")
        for old, new in replacements:
            assert source.count(old) == 1, f"{name} has {old!r} {source.count(old)} times"
            source = source.replace(old, new)
        file.write_text(source, encoding="utf-8")
        self.changed.add(name)

    def add(self, name: str, source: str) -> None:
        """Write a file that is not there yet."""
        with (self.folder / name).open("x", encoding="utf-8") as stream:
            stream.write(source)
        self.changed.add(name)

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run the command line of the copy."""
        return self._python("-m", "r2bspec", *arguments)

    def python(self, code: str) -> str:
        """What a program prints that imports the copy and the helpers of the tests."""
        done = self._python("-c", code)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def _python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        paths = os.pathsep.join([str(self.folder), str(ROOT / "tests" / "support")])
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
