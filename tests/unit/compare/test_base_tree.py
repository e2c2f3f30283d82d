"""The files of a base: written from the objects of git, and nothing of the repository runs."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from git_repositories import commit, git, write_files
from r2bspec.compare.base_tree import BaseRevisionError, open_base_tree

SPEC = "bench/blur.r2b.yaml"


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


@pytest.fixture
def top(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "repository"
    commit(folder, {SPEC: "one", "run.sh": "#!/bin/sh\n", "a/b/c.bin": bytes(range(256)) * 9000})
    (folder / "run.sh").chmod(0o755)
    (folder / "link").symlink_to("a/b")
    commit(folder)
    monkeypatch.chdir(folder)
    return folder


def refusal(revision: str, match: str | None = None) -> BaseRevisionError:
    """The error that a revision cannot be had."""
    with pytest.raises(BaseRevisionError, match=match) as caught, open_base_tree(revision):
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
    with open_base_tree("HEAD~1") as tree:
        assert files(tree.top) == before
        assert os.access(tree.top / "run.sh", os.X_OK)
        assert not os.access(tree.top / SPEC, os.X_OK)
        assert (tree.top / "link").readlink() == Path("a/b")
        assert {*tree.files} == {SPEC, "run.sh", "a/b/c.bin", "link"}
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
    with open_base_tree("HEAD") as tree:
        assert (tree.top / "id").read_text() == "$Id$\n"
    assert not proof.exists()


@pytest.mark.parametrize(
    ("revision", "message"),
    [
        ("mian", r"no revision 'mian'; did you mean 'main'\?$"),
        ("deadbeef", "no revision 'deadbeef'$"),
        ("--help", "no revision '--help'"),
        ("HEAD:bench", "no revision"),
        ("", "no revision ''$"),
    ],
)
def test_a_revision_that_git_does_not_know_is_said_with_a_way_out(
    temporary: Path, top: Path, revision: str, message: str
) -> None:
    assert "Give --base a revision" in refusal(revision, message).hint
    assert list(temporary.iterdir()) == []


def test_a_misspelt_branch_of_a_remote_is_answered_with_the_meant_branch(
    top: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    git(tmp_path, "clone", "--quiet", f"file://{top}", "clone")
    monkeypatch.chdir(tmp_path / "clone")
    assert str(refusal("orgin/main")).endswith("did you mean 'origin/main'?")


@pytest.mark.parametrize("options", ["--single-branch", "--depth=1"])
def test_a_clone_without_the_base_is_told_what_to_fetch(
    top: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: str
) -> None:
    git(top, "branch", "release/2")
    commit(top, {SPEC: "two"})
    git(tmp_path, "clone", "--quiet", options, f"file://{top}", "clone")
    clone = tmp_path / "clone"
    monkeypatch.chdir(clone)
    for name in ("origin/release/2", "refs/remotes/origin/release/2"):
        command = refusal(name).hint.removeprefix("Fetch it first: ").removesuffix(".")
    depth = " --depth=1" if "depth" in options else ""
    assert command == f"git fetch{depth} origin release/2:refs/remotes/origin/release/2"
    git(clone, *command.split()[1:])
    with open_base_tree("refs/remotes/origin/release/2") as tree:
        assert (tree.top / SPEC).read_text() == "one"
        assert tree.name.startswith("origin/release/2@")


def test_objects_that_are_missing_are_not_fetched(
    top: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    git(top, "config", "uploadpack.allowFilter", "true")
    options = ("--quiet", "--filter=blob:none", "--no-checkout")
    git(tmp_path, "clone", *options, f"file://{top}", "partial")
    monkeypatch.chdir(tmp_path / "partial")
    assert "--filter" in refusal("HEAD", "lacks objects").hint


def test_a_disk_that_is_full_is_said_and_leaves_nothing(
    top: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("r2bspec.compare.base_tree.os.fdopen", refuse)
    assert "TMPDIR" in refusal("HEAD", "No space left").hint
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("name", ["..", ".git", ".GIT"])
def test_paths_that_git_would_not_write_are_refused(top: Path, name: str) -> None:
    blob = git(top, "rev-parse", f"HEAD:{SPEC}")
    inner = git(top, "mktree", stdin=f"100644 blob {blob}\tx\n")
    outer = git(top, "mktree", stdin=f"040000 tree {inner}\t{name}\n")
    hostile = git(top, "commit-tree", "-m", "hostile", outer)
    refusal(hostile, "would not write")


def test_nothing_is_written_through_a_link_of_the_tree(top: Path, tmp_path: Path) -> None:
    link = git(top, "hash-object", "-w", "--stdin", stdin=str(tmp_path))
    blob = git(top, "rev-parse", f"HEAD:{SPEC}")
    inner = git(top, "mktree", stdin=f"120000 blob {blob}\tx\n")
    entries = f"120000 blob {link}\ta\n040000 tree {inner}\ta\n"
    outer = git(top, "mktree", "--missing", stdin=entries)
    hostile = git(top, "commit-tree", "-m", "hostile", outer)
    refusal(hostile, "would not write")
    assert not (tmp_path / "x").is_symlink()


@pytest.mark.parametrize("place", [".git/lfs/objects/{0}/{1}/{2}", "drive.mcap"])
def test_files_of_git_lfs_come_from_the_clone(top: Path, place: str) -> None:
    content = b"a recording\n" * 1000
    digest = hashlib.sha256(content).hexdigest()
    pointer = (
        f"version https://git-lfs.github.com/spec/v1\noid sha256:{digest}\nsize {len(content)}\n"
    )
    commit(top, {"drive.mcap": pointer})
    file = place.format(digest[:2], digest[2:4], digest)
    for stored, expected in ((b"damaged", pointer.encode()), (content, content)):
        write_files(top, {file: stored})
        with open_base_tree("HEAD") as tree:
            assert (tree.top / "drive.mcap").read_bytes() == expected
            assert bool(tree.notes) is (expected != content)


def test_submodules_are_named(top: Path, tmp_path: Path) -> None:
    commit(tmp_path / "other", {"x": "1"})
    git(top, "submodule", "--quiet", "add", str(tmp_path / "other"), "vendored")
    commit(top)
    with open_base_tree("HEAD") as tree:
        assert tree.notes == ("Submodules are not in the base: vendored.",)


def test_what_a_killed_process_left_is_removed_after_a_week(top: Path, temporary: Path) -> None:
    script = (
        "import os; from r2bspec.compare.base_tree import open_base_tree\n"
        "with open_base_tree('HEAD'):\n    os.kill(os.getpid(), 9)\n"
    )
    environment = {**os.environ, "TMPDIR": str(temporary)}
    subprocess.run([sys.executable, "-c", script], env=environment, check=False)
    (left,) = temporary.iterdir()
    with open_base_tree("HEAD"):
        assert left.exists(), "another process may use it"
    week_ago = time.time() - 8 * 24 * 3600
    os.utime(left, (week_ago, week_ago))
    with open_base_tree("HEAD") as first:
        assert list(temporary.iterdir()) == [first.top.parent]
        with open_base_tree("HEAD") as second:
            # The first one is in use.
            assert {first.top.parent, second.top.parent} == set(temporary.iterdir())
        assert first.top.is_dir()


def test_folders_that_a_build_made_unwritable_are_removed(top: Path, temporary: Path) -> None:
    with open_base_tree("HEAD") as tree:
        (tree.top / "a" / "b").chmod(0o500)
    assert list(temporary.iterdir()) == []
