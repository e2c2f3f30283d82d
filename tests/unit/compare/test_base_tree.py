"""The work tree of a base: written from the objects of git, and nothing of the repository runs."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from git_repositories import commit, git, write_files
from r2bspec.compare.base_reference import parse_base_reference
from r2bspec.compare.base_tree import BaseRevisionError, open_base_tree

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
    with open_base_tree(parse_base_reference(["HEAD~1"]), top / SPEC) as tree:
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
    with open_base_tree(parse_base_reference(["HEAD"]), top / SPEC) as tree:
        assert (tree.top / "id").read_text() == "$Id$\n"
    assert not proof.exists()


def test_where_a_branch_branched_off(top: Path) -> None:
    start = git(top, "rev-parse", "HEAD")
    git(top, "checkout", "--quiet", "-b", "topic")
    commit(top, {"topic": "1"})
    git(top, "checkout", "--quiet", "main")
    commit(top, {"later": "1"})
    git(top, "checkout", "--quiet", "topic")
    with open_base_tree(parse_base_reference(["main..."]), top / SPEC) as tree:
        assert tree.revision is not None
        assert tree.revision.commit == start
        assert tree.name == f"main@{start[:7]}"
        assert not (tree.top / "later").exists()


class Refused(NamedTuple):
    """A revision that cannot be had, and words of the message and of the way out."""

    revision: str
    message: str
    way_out: str


@pytest.mark.parametrize(
    "case",
    [
        Refused("mian", r"no revision 'mian'; did you mean 'main'\?$", "Give a revision"),
        Refused("deadbeef", "no revision 'deadbeef'$", "Give a revision"),
        Refused("--help", "no revision '--help'", "Give a revision"),
        Refused("HEAD:bench", "no revision", "Give a revision"),
        Refused("nothing...", "branched off", "Give a revision"),
    ],
    ids=lambda case: case.revision,
)
def test_a_revision_that_git_does_not_know_is_said_with_a_way_out(
    top: Path, temporary: Path, case: Refused
) -> None:
    with (
        pytest.raises(BaseRevisionError, match=case.message) as caught,
        open_base_tree(parse_base_reference([case.revision]), top / SPEC),
    ):
        pass
    assert case.way_out in caught.value.hint
    assert "git fetch" not in caught.value.hint
    assert list(temporary.iterdir()) == []


def refusal(revision: str, top: Path) -> tuple[str, str]:
    """What is said of a revision that git does not know."""
    with (
        pytest.raises(BaseRevisionError) as caught,
        open_base_tree(parse_base_reference([revision]), top / SPEC),
    ):
        pass
    return str(caught.value), caught.value.hint


def test_a_misspelt_branch_of_a_remote_is_answered_with_the_one_that_is_meant(
    top: Path, tmp_path: Path
) -> None:
    git(top, "branch", "stable")
    git(top, "tag", "v1.2")
    clone = tmp_path / "clone"
    git(tmp_path, "clone", "--quiet", f"file://{top}", str(clone))
    for wrong, meant in (("orgin/main", "origin/main"), ("origin/stabel", "origin/stable")):
        message, hint = refusal(wrong, clone)
        assert message == f"git knows no revision {wrong!r}; did you mean {meant!r}?"
        assert "fetch" not in hint
    assert refusal("v1.3", clone)[0].endswith("did you mean 'v1.2'?")
    assert "did you mean" not in refusal("0123456789", clone)[0]


def test_a_clone_of_a_single_branch_is_told_what_to_fetch(top: Path, tmp_path: Path) -> None:
    git(top, "branch", "release/2")
    clone = tmp_path / "clone"
    git(tmp_path, "clone", "--quiet", "--single-branch", f"file://{top}", str(clone))
    command = refusal("origin/release/2", clone)[1].split(": ", 1)[1].split(". ")[0]
    assert command == "git fetch origin release/2:refs/remotes/origin/release/2"
    git(clone, *command.split()[1:])
    with open_base_tree(parse_base_reference(["origin/release/2"]), clone / SPEC) as tree:
        assert (tree.top / SPEC).read_text() == "one"


def test_a_shallow_clone_is_told_what_to_fetch(top: Path, tmp_path: Path) -> None:
    commit(top, {"more": "1"})
    git(top, "branch", "stable", "HEAD~1")
    clone = tmp_path / "clone"
    git(tmp_path, "clone", "--quiet", "--depth=1", f"file://{top}", str(clone))
    with (
        pytest.raises(BaseRevisionError, match="this clone is shallow") as caught,
        open_base_tree(parse_base_reference(["origin/stable"]), clone / SPEC),
    ):
        pass
    command = caught.value.hint.split(": ", 1)[1].split(". ")[0]
    assert command == "git fetch --depth=1 origin stable:refs/remotes/origin/stable"
    # The way out is one.
    git(clone, *command.split()[1:])
    with open_base_tree(parse_base_reference(["origin/stable"]), clone / SPEC) as tree:
        assert (tree.top / SPEC).read_text() == "one"


def test_outside_of_a_repository(tmp_path: Path) -> None:
    folder = tmp_path / "plain"
    write_files(folder, {SPEC: "one"})
    with (
        pytest.raises(BaseRevisionError, match="no git repository"),
        open_base_tree(parse_base_reference(["main"]), folder / SPEC),
    ):
        pass


def test_objects_that_are_missing_are_not_fetched(top: Path, tmp_path: Path) -> None:
    clone = tmp_path / "partial"
    git(top, "config", "uploadpack.allowFilter", "true")
    git(
        tmp_path,
        "clone",
        "--quiet",
        "--filter=blob:none",
        "--no-checkout",
        f"file://{top}",
        "partial",
    )
    with (
        pytest.raises(BaseRevisionError, match="lacks objects") as caught,
        open_base_tree(parse_base_reference(["HEAD"]), clone),
    ):
        pass
    assert "--filter" in caught.value.hint


def test_a_full_disk_is_said_and_leaves_nothing(
    top: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(top)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage._replace(free=1000))
    with (
        pytest.raises(BaseRevisionError, match="cannot be written") as caught,
        open_base_tree(parse_base_reference(["HEAD"]), top / SPEC),
    ):
        pass
    assert "TMPDIR" in caught.value.hint
    assert list(temporary.iterdir()) == []


@pytest.mark.skipif(os.getuid() != 0, reason="a full disk is a small tmpfs, which root can mount")
def test_a_disk_that_becomes_full_is_said_and_leaves_nothing(
    top: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=512k", "none", str(small)],  # noqa: S607
        check=False,
    )
    if mounted.returncode:
        pytest.skip("this system allows no mount")
    try:
        monkeypatch.setattr("tempfile.tempdir", str(small))
        usage = shutil.disk_usage(top)
        monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage)
        with (
            pytest.raises(BaseRevisionError, match="No space left"),
            open_base_tree(parse_base_reference(["HEAD"]), top / SPEC),
        ):
            pass
        assert list(small.iterdir()) == []
    finally:
        subprocess.run(["umount", str(small)], check=False)  # noqa: S607


@pytest.mark.parametrize("name", ["..", ".git", ".GIT"])
def test_paths_that_git_would_not_write_are_refused(top: Path, name: str) -> None:
    blob = git(top, "rev-parse", f"HEAD:{SPEC}")
    inner = git(top, "mktree", stdin=f"100644 blob {blob}\tx\n")
    outer = git(top, "mktree", stdin=f"040000 tree {inner}\t{name}\n")
    hostile = git(top, "commit-tree", "-m", "hostile", outer)
    with (
        pytest.raises(BaseRevisionError, match="would not write"),
        open_base_tree(parse_base_reference([hostile]), top / SPEC),
    ):
        pass


def test_files_of_git_lfs_come_from_the_local_storage(top: Path) -> None:
    content = b"a recording\n" * 1000
    digest = hashlib.sha256(content).hexdigest()
    pointer = (
        f"version https://git-lfs.github.com/spec/v1\noid sha256:{digest}\nsize {len(content)}\n"
    )
    commit(top, {"drive.mcap": pointer})
    with open_base_tree(parse_base_reference(["HEAD"]), top / SPEC) as tree:
        assert (tree.top / "drive.mcap").read_text() == pointer
        assert "drive.mcap" in tree.notes[0]
    write_files(top, {f".git/lfs/objects/{digest[:2]}/{digest[2:4]}/{digest}": content})
    with open_base_tree(parse_base_reference(["HEAD"]), top / SPEC) as tree:
        assert (tree.top / "drive.mcap").read_bytes() == content
        assert tree.notes == ()
    write_files(top, {f".git/lfs/objects/{digest[:2]}/{digest[2:4]}/{digest}": b"damaged"})
    with (
        pytest.raises(BaseRevisionError, match="damaged"),
        open_base_tree(parse_base_reference(["HEAD"]), top / SPEC),
    ):
        pass


def test_submodules_are_named(top: Path, tmp_path: Path) -> None:
    commit(tmp_path / "other", {"x": "1"})
    git(top, "submodule", "--quiet", "add", str(tmp_path / "other"), "vendored")
    commit(top)
    with open_base_tree(parse_base_reference(["HEAD"]), top / SPEC) as tree:
        assert tree.notes == ("Submodules are empty in the base: vendored.",)


def test_another_work_tree_is_used_as_it_is(top: Path, tmp_path: Path, temporary: Path) -> None:
    base = tmp_path / "base"
    git(top, "worktree", "add", "--quiet", "--detach", str(base))
    (base / SPEC).write_text("changed")
    with open_base_tree(parse_base_reference([str(base)]), top / SPEC) as tree:
        assert (tree.top, tree.head_top) == (base, top)
        assert tree.revision is not None
        assert tree.revision.dirty
        assert tree.name.startswith("base@")
        assert tree.name.endswith("+dirty")
    assert (base / SPEC).read_text() == "changed"
    with (
        pytest.raises(BaseRevisionError, match="the work tree of the head"),
        open_base_tree(parse_base_reference([str(top / "bench")]), top / SPEC),
    ):
        pass


def test_what_a_killed_process_left_is_removed_by_the_next(top: Path, temporary: Path) -> None:
    script = (
        "import os, sys, tempfile; from pathlib import Path;"
        "from r2bspec.compare.base_reference import parse_base_reference;"
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
    with open_base_tree(parse_base_reference(["HEAD"]), top / SPEC) as tree:
        (tree.top / "a" / "b").chmod(0o500)
    assert list(temporary.iterdir()) == []
