"""Promise: git reads a work tree, and nothing that its repository names is executed."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from r2bspec.safe_io.git import (
    WorkTreeState,
    commit_of,
    filter_names,
    find_work_tree,
    inspect_work_tree,
    run_git,
)


def git(folder: Path, *arguments: str) -> str:
    program = shutil.which("git")
    assert program is not None
    author = ["-c", "user.name=A", "-c", "user.email=a@example.org"]
    done = subprocess.run(
        [program, *author, *arguments], cwd=folder, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.fixture(name="top")
def new_repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with one commit of two files."""
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", "/dev/null")
    top = tmp_path / "a repository"
    (top / "bench").mkdir(parents=True)
    git(top, "init", "-q", "-b", "main")
    (top / "node.py").write_text("a = 1\n")
    (top / "bench" / "spec.yaml").write_text("name: a\n")
    git(top, "add", "-A")
    git(top, "commit", "-q", "-m", "first")
    return top


def state_of(top: Path) -> WorkTreeState:
    state = inspect_work_tree(top)
    assert state is not None
    return state


def test_a_clean_work_tree_has_its_commit_and_no_changes(top: Path) -> None:
    assert state_of(top) == WorkTreeState(git(top, "rev-parse", "HEAD"), ())


def test_changed_deleted_and_staged_files_are_named_and_untracked_ones_are_not(top: Path) -> None:
    (top / "node.py").write_text("a = 2\n")
    (top / "bench" / "spec.yaml").unlink()
    (top / "with space.py").write_text("new")
    git(top, "add", "with space.py")
    (top / "untracked.py").write_text("")
    assert state_of(top).changed == ("bench/spec.yaml", "node.py", "with space.py")


def test_a_touched_file_has_not_changed_and_the_index_is_not_written(top: Path) -> None:
    (top / "node.py").touch()
    before = (top / ".git" / "index").read_bytes()
    assert state_of(top).changed == ()
    assert (top / ".git" / "index").read_bytes() == before


def test_a_conflict_is_a_change(top: Path) -> None:
    git(top, "checkout", "-q", "-b", "other")
    (top / "node.py").write_text("a = 3\n")
    git(top, "commit", "-qam", "other")
    git(top, "checkout", "-q", "main")
    (top / "node.py").write_text("a = 4\n")
    git(top, "commit", "-qam", "main")
    with pytest.raises(subprocess.CalledProcessError):
        git(top, "merge", "other")
    assert state_of(top).changed == ("node.py",)


def test_a_repository_without_a_commit_has_none(tmp_path: Path) -> None:
    git(tmp_path, "init", "-q")
    assert state_of(tmp_path).commit == ""


def test_a_linked_work_tree_has_a_commit_of_its_own(top: Path, tmp_path: Path) -> None:
    linked = tmp_path / "linked"
    git(top, "worktree", "add", "-q", "-b", "side", str(linked))
    (linked / "node.py").write_text("a = 5\n")
    git(linked, "commit", "-qam", "side")
    assert (linked / ".git").is_file()
    state = state_of(linked)
    assert state.commit == git(linked, "rev-parse", "HEAD") != git(top, "rev-parse", "HEAD")
    assert state.changed == ()
    assert find_work_tree(linked / "bench") == linked


def test_a_folder_outside_of_a_repository_has_no_work_tree(tmp_path: Path) -> None:
    assert find_work_tree(tmp_path) is None


@pytest.mark.parametrize("content", ["gitdir: nowhere\n", "rubbish"])
def test_a_damaged_repository_is_unknown(tmp_path: Path, content: str) -> None:
    (tmp_path / ".git").write_text(content)
    assert inspect_work_tree(tmp_path) is None


def test_without_git_everything_is_unknown(top: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(top))
    assert run_git(top, "version") is None
    assert inspect_work_tree(top) is None
    assert commit_of(top, "HEAD") is None


def test_a_revision_is_looked_up_by_any_of_its_names(top: Path) -> None:
    commit = git(top, "rev-parse", "HEAD")
    assert commit_of(top, "main") == commit_of(top, commit[:10]) == commit
    assert commit_of(top, "--help") is None
    assert commit_of(top, "HEAD:node.py") is None


def test_variables_that_name_another_repository_are_dropped(
    top: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    git(other, "init", "-q")
    commit = git(top, "rev-parse", "HEAD")
    monkeypatch.setenv("GIT_DIR", str(other / ".git"))
    monkeypatch.setenv("GIT_WORK_TREE", str(other))
    monkeypatch.setenv("GIT_INDEX_FILE", str(other / "index"))
    assert state_of(top) == WorkTreeState(commit, ())


def test_the_work_tree_that_a_configuration_names_is_not_looked_at(
    top: Path, tmp_path: Path
) -> None:
    git(top, "config", "core.worktree", str(tmp_path / "elsewhere"))
    assert state_of(top).changed == ()


class HostileRepository:
    """A repository whose configuration names programs that leave a mark."""

    def __init__(self, top: Path) -> None:
        self.top = top
        self.mark = top / "executed"
        program = top.parent / "program.sh"
        program.write_text(f"#!/bin/sh\necho \"$0 $*\" >> '{self.mark}'\ncat\n")
        program.chmod(0o755)
        self.program = f"'{program}'"
        hooks = top.parent / "hooks"
        hooks.mkdir()
        for hook in ("post-index-change", "post-checkout", "reference-transaction"):
            shutil.copy(program, hooks / hook)
        self.hooks = hooks


@pytest.fixture(name="hostile")
def new_hostile_repository(top: Path) -> HostileRepository:
    hostile = HostileRepository(top)
    git(top, "config", "core.fsmonitor", hostile.program)
    git(top, "config", "core.hooksPath", str(hostile.hooks))
    for name in ("evil", "with=equals", "dotted.name"):
        for key in ("clean", "smudge", "process"):
            git(top, "config", f"filter.{name}.{key}", hostile.program)
        git(top, "config", f"filter.{name}.required", "true")
    (top / ".git" / "info" / "attributes").write_text(
        "*.py filter=evil\n*.txt filter=with=equals\n*.yaml filter=dotted.name\n"
    )
    # The times of the files must not tell git that they are unchanged.
    (top / "node.py").write_text("a = 7\n")
    (top / "bench" / "spec.yaml").write_text("name: b\n")
    return hostile


def test_the_names_of_filters_are_read_whole(hostile: HostileRepository) -> None:
    assert sorted(filter_names(hostile.top) or ()) == ["dotted.name", "evil", "with=equals"]


def test_the_hostile_configuration_is_effective_without_precautions(
    hostile: HostileRepository,
) -> None:
    subprocess.run(["git", "status"], cwd=hostile.top, capture_output=True, check=False)  # noqa: S607
    assert hostile.mark.exists()


def test_neither_monitors_nor_hooks_nor_filters_are_executed(hostile: HostileRepository) -> None:
    state = state_of(hostile.top)
    assert state.changed == ("bench/spec.yaml", "node.py")
    assert commit_of(hostile.top, "main") == state.commit
    assert run_git(hostile.top, "cat-file", "blob", "main:node.py") is not None
    assert not hostile.mark.exists()


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
