"""The VS Code extension: what it says about r2bspec is true, and it can be built."""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path
from typing import Any

import pytest

from r2bspec.cli.main import main
from vscode_extension import EXTENSION, npm, packaged

ROOT = Path(__file__).parents[2]
COLOUR = r"(?:\x1b\[[0-9;]*m)*"


def manifest() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((EXTENSION / "package.json").read_text("utf-8"))
    return found


def matcher() -> dict[str, Any]:
    found: dict[str, Any] = manifest()["contributes"]["problemMatchers"][0]["pattern"]
    return found


def test_the_problem_matcher_reads_what_validate_prints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = tmp_path / "relay.r2b.yaml"
    text = (ROOT / "specs" / "relay.r2b.yaml").read_text("utf-8")
    spec.write_text(text.replace("iterations: 10", "iteratons: 10"), "utf-8")
    assert main(["validate", str(spec)]) == 1
    pattern = matcher()
    lines = capsys.readouterr().out.splitlines()
    (found,) = filter(None, (re.match(pattern["regexp"], output_line) for output_line in lines))
    keys = ("file", "line", "column", "severity", "code")
    line = text.splitlines().index("  iterations: 10") + 1
    assert [found[pattern[key]] for key in keys] == [str(spec), str(line), "3", "error", "R2B101"]
    assert found[pattern["message"]] == "unknown key 'iteratons' in 'benchmark'"


def test_it_is_the_matcher_of_github_without_colours() -> None:
    file = ROOT / ".github" / "r2bspec-problem-matcher.json"
    (theirs,) = json.loads(file.read_text("utf-8"))["problemMatcher"][0]["pattern"]
    plain = theirs["regexp"].replace(COLOUR, "").replace("(.*?)$", "(.*)$")
    assert matcher() == theirs | {"regexp": plain}


def test_every_file_that_the_manifest_names_is_there() -> None:
    given = manifest()["contributes"]
    paths = [each["configuration"] for each in given["languages"]]
    paths += [each["path"] for each in given["grammars"]]
    for path in paths:
        json.loads((EXTENSION / path).read_text("utf-8"))


def test_the_lock_file_names_no_registry() -> None:
    lock = json.loads((EXTENSION / "package-lock.json").read_text("utf-8"))
    packages = {name: each for name, each in lock["packages"].items() if name}
    assert [name for name, each in packages.items() if "resolved" in each] == []
    assert all(package["integrity"].startswith("sha512-") for package in packages.values())


@pytest.mark.timeout(500)
def test_its_own_tests_pass_and_it_is_packaged(tmp_path: Path) -> None:
    file = packaged(tmp_path)
    tested = npm(file.parent, "test")
    assert tested.returncode == 0, tested.stdout
    with zipfile.ZipFile(file) as content:
        names = {each for each in content.namelist() if each.startswith("extension/")}
    assert names == {
        "extension/LICENSE.txt",
        "extension/dist/extension.js",
        "extension/language-configuration.json",
        "extension/package.json",
        "extension/readme.md",
        "extension/syntaxes/r2bspec.tmLanguage.json",
        "extension/syntaxes/values.tmLanguage.json",
    }
