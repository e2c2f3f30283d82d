"""What a shell proposes, and the pages that are installed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from example_spec import example
from r2bspec.cli.main import main
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
def test_the_script_of_a_shell_asks_r2bspec(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    assert f"_R2BSPEC_COMPLETE={shell}_complete" in capsys.readouterr().out


def test_every_page_of_the_documentation_is_listed_and_printed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["docs"]) == 0
    listed = {line.split()[0] for line in capsys.readouterr().out.splitlines()}
    folder = docs_folder()
    pages = {file.relative_to(folder).with_suffix("").as_posix() for file in folder.rglob("*.md")}
    assert listed == pages
    assert {"language", "running", "metrics"} <= listed
    assert main(["docs", "metrics"]) == 0
    assert capsys.readouterr().out.startswith("# Metrics\n")
    assert main(["docs", "proofs/verdicts"]) == 0
    assert capsys.readouterr().out.startswith("# Proofs of the verdicts")
    assert main(["docs", "running", "--path"]) == 0
    assert Path(capsys.readouterr().out.strip()).is_file()
    assert main(["docs", "runing"]) == 2
    assert "did you mean 'running'?" in capsys.readouterr().err
