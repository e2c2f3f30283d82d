"""What a shell proposes, and the pages that are installed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from command_line import Call
from example_spec import example
from r2bspec.cli.reference import docs_folder


def proposed(*words: str) -> set[str]:
    """What r2bspec proposes for the last of these words, as bash asks for it."""
    environment = os.environ | {
        "_R2BSPEC_COMPLETE": "bash_complete",
        "COMP_WORDS": " ".join(["r2bspec", *words]),
        "COMP_CWORD": str(len(words)),
    }
    asked = [sys.executable, "-m", "r2bspec"]
    done = subprocess.run(asked, env=environment, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    return {line.partition(",")[2] for line in done.stdout.splitlines() if line}


def test_verbs_templates_codes_datasets_and_formats_are_proposed() -> None:
    assert {"run", "report"} <= proposed("r")
    assert "minimal" in proposed("init", "--template", "m")
    assert {"R2B204", "R2B207"} <= proposed("explain", "R2B20")
    assert "remapping-unmatched" in proposed("explain", "remapping")
    assert {"latency.p99", "latency.p99_9"} <= proposed("metrics", "latency.p99")
    assert "r2b_storage" in proposed("data", "verify", "r2b_")
    assert {"html=", "hdrhistogram="} == proposed("run", "a.r2b.yaml", "--report", "h")


def test_cases_and_variables_of_the_spec_are_proposed(tmp_path: Path) -> None:
    spec = tmp_path / "a.r2b.yaml"
    matrix = "variables: {threads: 1}\nmatrix: {axes: {threads: [1, 2]}}\n"
    spec.write_text(example() + matrix)
    assert proposed("run", str(spec), "--case", "") == {"threads=1", "threads=2", "all"}
    assert proposed("plan", str(spec), "--var", "t") == {"threads="}


def test_a_spec_that_cannot_be_read_proposes_nothing(tmp_path: Path) -> None:
    assert proposed("run", str(tmp_path / "none.r2b.yaml"), "--case", "t") == set()


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_a_shell_asks_r2bspec(shell: str, call: Call) -> None:
    assert f"_R2BSPEC_COMPLETE={shell}_complete" in call("completion", shell, status=0).out


def test_every_page_of_the_documentation_is_listed_and_printed(call: Call) -> None:
    listed = {line.split()[0] for line in call("docs", status=0).out.splitlines()}
    folder = docs_folder()
    pages = {file.relative_to(folder).with_suffix("").as_posix() for file in folder.rglob("*.md")}
    assert listed == pages
    assert {"language", "running", "metrics"} <= listed
    assert call("docs", "metrics", status=0).out.startswith("# Metrics\n")
    assert call("docs", "proofs/verdicts", status=0).out.startswith("# Proofs of the verdicts")
    assert Path(call("docs", "running", "--path", status=0).out.strip()).is_file()
    assert "did you mean 'running'?" in call("docs", "runing", status=2).err
