"""Promise: git reads a work tree, and nothing that its repository names is executed."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from git_repositories import commit, git, write_files
from r2bspec.safe_io.git import WorkTreeState, commit_of, find_work_tree, inspect_work_tree, run_git


@pytest.fixture(name="top")
def new_repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with one commit of two files."""
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", "/dev/null")
    top = tmp_path / "a repository"
    commit(top, {"node.py": "a = 1\n", "bench/spec.yaml": "name: a\n"})
    return top


def state_of(top: Path) -> WorkTreeState:
    state = inspect_work_tree(top)
    assert state is not None
    return state


def test_changed_deleted_and_staged_files_are_named_and_untracked_ones_are_not(top: Path) -> None:
    (top / "node.py").write_text("a = 2\n")
    (top / "bench" / "spec.yaml").unlink()
    (top / "with space.py").write_text("new")
    git(top, "add", "with space.py")
    (top / "untracked.py").write_text("")
    assert state_of(top).changed == ("bench/spec.yaml", "node.py", "with space.py")


def test_a_folder_without_a_repository_or_a_commit_has_none(tmp_path: Path) -> None:
    assert find_work_tree(tmp_path) is None
    git(tmp_path, "init", "-q")
    assert state_of(tmp_path).commit == ""


@pytest.mark.parametrize("content", ["gitdir: nowhere\n", "rubbish"])
def test_a_damaged_repository_is_unknown(tmp_path: Path, content: str) -> None:
    (tmp_path / ".git").write_text(content)
    assert inspect_work_tree(tmp_path) is None


def test_without_git_everything_is_unknown(top: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(top))
    assert run_git(top, "version") is None
    assert inspect_work_tree(top) is None
    assert commit_of(top, "HEAD") is None


def test_variables_that_name_another_repository_are_dropped(
    top: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other"
    commit(other)
    before = state_of(top)
    monkeypatch.setenv("GIT_DIR", str(other / ".git"))
    monkeypatch.setenv("GIT_WORK_TREE", str(other))
    monkeypatch.setenv("GIT_INDEX_FILE", str(other / "index"))
    assert state_of(top) == before


@pytest.fixture
def mark(top: Path) -> Path:
    """What programs leave that the configuration of the repository now names."""
    mark = top / "executed"
    program = top.parent / "program.sh"
    program.write_text(f"#!/bin/sh\necho \"$0 $*\" >> '{mark}'\ncat\n")
    program.chmod(0o755)
    hooks = top.parent / "hooks"
    hooks.mkdir()
    for hook in ("post-index-change", "post-checkout", "reference-transaction"):
        shutil.copy(program, hooks / hook)
    git(top, "config", "core.fsmonitor", f"'{program}'")
    git(top, "config", "core.hooksPath", str(hooks))
    for name in ("evil", "with=equals", "dotted.name"):
        for key in ("clean", "smudge", "process"):
            git(top, "config", f"filter.{name}.{key}", f"'{program}'")
        git(top, "config", f"filter.{name}.required", "true")
    (top / ".git" / "info" / "attributes").write_text(
        "*.py filter=evil\n*.txt filter=with=equals\n*.yaml filter=dotted.name\n"
    )
    # The times of the files must not tell git that they are unchanged.
    write_files(top, {"node.py": "a = 7\n", "bench/spec.yaml": "name: b\n"})
    return mark


def test_neither_monitors_nor_hooks_nor_filters_are_executed(top: Path, mark: Path) -> None:
    state = state_of(top)
    assert state.changed == ("bench/spec.yaml", "node.py")
    assert commit_of(top, "main") == state.commit
    assert run_git(top, "cat-file", "blob", "main:node.py") is not None
    assert not mark.exists()
    # Without precautions they are.
    subprocess.run(["git", "status"], cwd=top, capture_output=True, check=False)  # noqa: S607
    assert mark.exists()


def test_no_missing_object_is_fetched(top: Path, tmp_path: Path) -> None:
    source = tmp_path / "source"
    git(top, "clone", "-q", "--bare", str(top), str(source))
    git(source, "config", "uploadpack.allowFilter", "true")
    partial = tmp_path / "partial"
    options = ("-q", "--no-checkout", "--filter=blob:none")
    git(tmp_path, "clone", *options, f"file://{source}", "partial")
    done = run_git(partial, "cat-file", "blob", "HEAD:node.py")
    assert done is not None
    assert done.returncode != 0
    # It can be fetched by those who want it.
    assert git(partial, "cat-file", "blob", "HEAD:node.py") == "a = 1"
