"""The work tree of a base: written from the objects of git, and nothing of the repository runs."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import subprocess
import sys
from contextlib import AbstractContextManager
from pathlib import Path
from typing import IO

import pytest

from git_repositories import commit, git, write_files
from r2bspec.compare import base_tree
from r2bspec.compare.base_tree import (
    BaseRevisionError,
    BaseTree,
    open_base_tree,
    parse_base_reference,
)

SPEC = "bench/blur.r2b.yaml"


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


@pytest.fixture
def top(tmp_path: Path) -> Path:
    folder = tmp_path / "repository"
    commit(folder, {SPEC: "one", "run.sh": "#!/bin/sh\n", "a/b/c.bin": bytes(range(256)) * 9000})
    (folder / "run.sh").chmod(0o755)
    (folder / "link").symlink_to("a/b")
    commit(folder)
    return folder


def base_of(revision: str, place: Path) -> AbstractContextManager[BaseTree]:
    return open_base_tree(parse_base_reference([revision]), place)


def refusal(revision: str, place: Path, match: str | None = None) -> BaseRevisionError:
    """The error that a revision cannot be had."""
    with pytest.raises(BaseRevisionError, match=match) as caught, base_of(revision, place):
        pass
    return caught.value


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and ".git" not in path.parts
    }


def test_a_revision_is_written_as_a_checkout_would_be_and_removed(
    top: Path, temporary: Path
) -> None:
    before = files(top)
    first = git(top, "rev-parse", "HEAD")
    commit(top, {SPEC: "two"})
    with base_of("HEAD~1", top / SPEC) as tree:
        assert files(tree.top) == before
        assert os.access(tree.top / "run.sh", os.X_OK)
        assert not os.access(tree.top / SPEC, os.X_OK)
        assert (tree.top / "link").readlink() == Path("a/b")
        assert (tree.head_top, tree.notes) == (top, ())
        assert tree.name == f"HEAD~1@{first[:7]}"
        assert tree.in_base(top / SPEC) == tree.top / SPEC
        assert tree.in_base(Path("/etc/passwd")) is None
        assert not tree.top.is_relative_to(top)
    assert list(temporary.iterdir()) == []
    assert git(top, "worktree", "list").count("\n") == 0


def test_nothing_that_the_repository_names_runs(top: Path, tmp_path: Path) -> None:
    proof = tmp_path / "ran"
    program = tmp_path / "program"
    program.write_text(f"#!/bin/sh\ntouch {proof}\ncat\n")
    program.chmod(0o755)
    commit(top, {".gitattributes": "* filter=evil ident export-subst\n", "id": "$Id$\n"})
    for key in ("filter.evil.smudge", "filter.evil.process", "core.fsmonitor", "core.pager"):
        git(top, "config", key, str(program))
    hook = top / ".git/hooks/post-checkout"
    hook.parent.mkdir(exist_ok=True)
    shutil.copy(program, hook)
    with base_of("HEAD", top / SPEC) as tree:
        assert (tree.top / "id").read_text() == "$Id$\n"
    assert not proof.exists()


def test_where_a_branch_branched_off(top: Path) -> None:
    start = git(top, "rev-parse", "HEAD")
    git(top, "checkout", "--quiet", "-b", "topic")
    commit(top, {"topic": "1"})
    git(top, "checkout", "--quiet", "main")
    commit(top, {"later": "1"})
    git(top, "checkout", "--quiet", "topic")
    with base_of("main...", top / SPEC) as tree:
        assert tree.revision is not None
        assert tree.revision.commit == start
        assert tree.name == f"main@{start[:7]}"
        assert not (tree.top / "later").exists()


@pytest.mark.parametrize(
    ("revision", "message"),
    [
        ("mian", r"no revision 'mian'; did you mean 'main'\?$"),
        ("deadbeef", "no revision 'deadbeef'$"),
        ("--help", "no revision '--help'"),
        ("HEAD:bench", "no revision"),
        ("nothing...", "no revision 'nothing'$"),
        ("origin/main", r"no revision 'origin/main'; did you mean 'main'\?$"),
    ],
)
def test_a_revision_that_git_does_not_know_is_said_with_a_way_out(
    top: Path, temporary: Path, revision: str, message: str
) -> None:
    hint = refusal(revision, top / SPEC, message).hint
    assert "Give a revision" in hint
    assert "git fetch" not in hint
    assert list(temporary.iterdir()) == []


def test_a_misspelt_branch_of_a_remote_is_answered_with_the_one_that_is_meant(
    top: Path, tmp_path: Path
) -> None:
    git(top, "branch", "stable")
    git(top, "tag", "v1.2")
    clone = tmp_path / "clone"
    git(tmp_path, "clone", "--quiet", f"file://{top}", str(clone))
    for wrong, meant in (("orgin/main", "origin/main"), ("origin/stabel", "origin/stable")):
        error = refusal(wrong, clone / SPEC)
        assert str(error) == f"git knows no revision {wrong!r}; did you mean {meant!r}?"
        assert "fetch" not in error.hint
    assert str(refusal("v1.3", clone / SPEC)).endswith("did you mean 'v1.2'?")
    assert "did you mean" not in str(refusal("0123456789", clone / SPEC))


def follow_hint(clone: Path, revision: str, command: str) -> None:
    """The way out of a revision that is not there is one."""
    assert refusal(revision, clone / SPEC).hint.split(": ", 1)[1].split(". ")[0] == command
    git(clone, *command.split()[1:])
    with base_of(revision, clone / SPEC) as tree:
        assert (tree.top / SPEC).read_text() == "one"


def test_a_clone_of_a_single_branch_is_told_what_to_fetch(top: Path, tmp_path: Path) -> None:
    git(top, "branch", "release/2")
    clone = tmp_path / "clone"
    git(tmp_path, "clone", "--quiet", "--single-branch", f"file://{top}", str(clone))
    command = "git fetch origin release/2:refs/remotes/origin/release/2"
    follow_hint(clone, "origin/release/2", command)


def test_a_shallow_clone_is_told_what_to_fetch(top: Path, tmp_path: Path) -> None:
    commit(top, {"more": "1"})
    git(top, "branch", "stable", "HEAD~1")
    clone = tmp_path / "clone"
    git(tmp_path, "clone", "--quiet", "--depth=1", f"file://{top}", str(clone))
    fetch = "git fetch --depth=1 origin stable:refs/remotes/origin/stable"
    for name, more in (("origin/stable", ""), ("stable", ", and name it origin/stable")):
        error = refusal(name, clone / SPEC)
        # What it has is the change itself, which is no base.
        assert str(error).endswith("this clone is shallow, and does not have it")
        assert f"Fetch it first: {fetch}{more}." in error.hint
    follow_hint(clone, "origin/stable", fetch)
    assert str(refusal("stable", clone / SPEC)).endswith("did you mean 'origin/stable'?")


def test_outside_of_a_repository(tmp_path: Path) -> None:
    folder = tmp_path / "plain"
    write_files(folder, {SPEC: "one"})
    refusal("main", folder / SPEC, "no git repository")


def test_objects_that_are_missing_are_not_fetched(top: Path, tmp_path: Path) -> None:
    clone = tmp_path / "partial"
    git(top, "config", "uploadpack.allowFilter", "true")
    options = ("--quiet", "--filter=blob:none", "--no-checkout")
    git(tmp_path, "clone", *options, f"file://{top}", "partial")
    assert "--filter" in refusal("HEAD", clone, "lacks objects").hint


def test_a_full_disk_is_said_and_leaves_nothing(
    top: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(top)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage._replace(free=1000))
    assert "TMPDIR" in refusal("HEAD", top / SPEC, "cannot be written").hint
    assert list(temporary.iterdir()) == []


def test_a_disk_that_becomes_full_is_said_and_leaves_nothing(
    top: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = iter(range(2))

    def read(source: IO[bytes], size: int) -> bytes:
        if next(written, None) is None:
            raise OSError(errno.ENOSPC, "No space left on device")
        return source.read(size)

    monkeypatch.setattr(base_tree, "_read", read)
    refusal("HEAD", top / SPEC, "No space left")
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("name", ["..", ".git", ".GIT"])
def test_paths_that_git_would_not_write_are_refused(top: Path, name: str) -> None:
    blob = git(top, "rev-parse", f"HEAD:{SPEC}")
    inner = git(top, "mktree", stdin=f"100644 blob {blob}\tx\n")
    outer = git(top, "mktree", stdin=f"040000 tree {inner}\t{name}\n")
    hostile = git(top, "commit-tree", "-m", "hostile", outer)
    refusal(hostile, top / SPEC, "would not write")


def test_files_of_git_lfs_come_from_the_local_storage(top: Path) -> None:
    content = b"a recording\n" * 1000
    digest = hashlib.sha256(content).hexdigest()
    pointer = (
        f"version https://git-lfs.github.com/spec/v1\noid sha256:{digest}\nsize {len(content)}\n"
    )
    commit(top, {"drive.mcap": pointer})
    with base_of("HEAD", top / SPEC) as tree:
        assert (tree.top / "drive.mcap").read_text() == pointer
        assert "drive.mcap" in tree.notes[0]
    write_files(top, {f".git/lfs/objects/{digest[:2]}/{digest[2:4]}/{digest}": content})
    with base_of("HEAD", top / SPEC) as tree:
        assert (tree.top / "drive.mcap").read_bytes() == content
        assert tree.notes == ()
    write_files(top, {f".git/lfs/objects/{digest[:2]}/{digest[2:4]}/{digest}": b"damaged"})
    refusal("HEAD", top / SPEC, "damaged")


def test_submodules_are_named(top: Path, tmp_path: Path) -> None:
    commit(tmp_path / "other", {"x": "1"})
    git(top, "submodule", "--quiet", "add", str(tmp_path / "other"), "vendored")
    commit(top)
    with base_of("HEAD", top / SPEC) as tree:
        assert tree.notes == ("Submodules are empty in the base: vendored.",)


def test_another_work_tree_is_used_as_it_is(top: Path, tmp_path: Path, temporary: Path) -> None:
    base = tmp_path / "base"
    git(top, "worktree", "add", "--quiet", "--detach", str(base))
    (base / SPEC).write_text("changed")
    with base_of(str(base), top / SPEC) as tree:
        assert (tree.top, tree.head_top) == (base, top)
        assert tree.revision is not None
        assert tree.revision.dirty
        assert tree.name.startswith("base@")
        assert tree.name.endswith("+dirty")
    assert (base / SPEC).read_text() == "changed"
    refusal(str(top / "bench"), top / SPEC, "the work tree of the head")


def test_what_a_killed_process_left_is_removed_by_the_next(top: Path, temporary: Path) -> None:
    script = (
        "import os, sys, tempfile; from pathlib import Path;"
        "from r2bspec.compare.base_tree import parse_base_reference;"
        "from r2bspec.compare.base_tree import open_base_tree\n"
        f"with open_base_tree(parse_base_reference(['HEAD']), Path({str(top / SPEC)!r})):\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    environment = {**os.environ, "TMPDIR": str(temporary)}
    subprocess.run([sys.executable, "-c", script], env=environment, check=False)
    assert len(list(temporary.iterdir())) == 1
    reference = parse_base_reference(["HEAD"])
    with open_base_tree(reference, top / SPEC) as first:
        assert list(temporary.iterdir()) == [first.top.parent]
        with open_base_tree(reference, top / SPEC) as second:
            # The first one is in use.
            assert {first.top.parent, second.top.parent} == set(temporary.iterdir())
        assert first.top.is_dir()


def test_folders_that_a_build_made_unwritable_are_removed(top: Path, temporary: Path) -> None:
    with base_of("HEAD", top / SPEC) as tree:
        (tree.top / "a" / "b").chmod(0o500)
    assert list(temporary.iterdir()) == []
