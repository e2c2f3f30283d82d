"""Promise: what is known of one middleware is in `r2bspec.middleware`, and nowhere else."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[3] / "r2bspec"
OUTSIDE = sorted(
    file
    for file in PACKAGE.rglob("*")
    if file.suffix in {".py", ".j2", ".yaml", ".json"} and "middleware" not in file.parts
)
NAMES = re.compile(
    r"(?i:fast[ _-]?(rtps|dds))|(CYCLONEDDS|ZENOH)_|AUTOMATIC_DISCOVERY|STATIC_PEERS|LOCALHOST_ONLY"
)


def test_the_names_are_found_where_they_belong() -> None:
    modules = (PACKAGE / "middleware").glob("*.py")
    found = {file.name for file in modules if NAMES.search(file.read_text())}
    assert {"fast_dds.py", "cyclone_dds.py", "middleware.py"} <= found


def test_no_other_module_names_a_middleware_or_its_variables() -> None:
    assert len(OUTSIDE) > 400
    found = {
        f"{file.relative_to(PACKAGE)}: {match[0]}"
        for file in OUTSIDE
        for match in NAMES.finditer(file.read_text(encoding="utf-8"))
    }
    assert found == set()


@pytest.mark.parametrize(
    "name", ["fast_dds", "fast_dds_profile", "fast_dds_shm_files", "cyclone_dds"]
)
def test_no_other_module_imports_that_of_one(name: str) -> None:
    imports = re.compile(rf"middleware(\.| import ){name}\b")
    assert not [file for file in OUTSIDE if imports.search(file.read_text(encoding="utf-8"))]
