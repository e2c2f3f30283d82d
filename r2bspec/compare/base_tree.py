"""The base of a gate: a commit, its files as git lists them, and a private copy of them.

The copy is written from the objects of the repository, byte for byte, into a folder outside of it,
which is removed at the end. Nothing that a repository can contain is executed or applied: no hook,
no filter, no attribute, no replaced object, no graft; and nothing is fetched. ``git archive`` would
apply the attributes of the very tree that is compared: files could leave themselves out.

A name that two references have is refused: a tag or a branch that somebody pushed must not take the
place of the branch that a pipeline means.

Files of Git LFS are taken from the storage of the clone, or from the work tree where it has the
same content. Submodules are not in the copy. What is missing is named in a note.

A head that lacks commits of the base is compared with the commit where it left. It can leave as
early as it likes, so what the gate has become since counts, too: see `BaseTree.newer`.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import IO

from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.quote import clip, first_words, pluralize
from r2bspec.errors import UsageError
from r2bspec.record.graph_identity import Revision, revision_text
from r2bspec.safe_io import git
from r2bspec.safe_io.private_files import temporary_folder
from r2bspec.safe_io.safe_file import is_regular

HINT = "Give --base a revision that this clone has, such as refs/remotes/origin/main."

_BLOCK_BYTES = 1 << 20
_MAX_POINTER_BYTES = 1024
_LFS_POINTER = re.compile(
    rb"version https://git-lfs\.github\.com/spec/v1\n(?:ext-.*\n)*"
    rb"oid sha256:([0-9a-f]{64})\nsize \d{1,15}\n"
)
_COMMIT = re.compile("[0-9a-f]{40}")


class BaseRevisionError(UsageError):
    """The base of a gate cannot be obtained as files."""

    code = "R2B694"


@dataclass(frozen=True)
class BaseTree:
    """The files of the base.

    Attributes:
        top: the folder with the copy.
        head_top: the top of the work tree of the head, which has the same layout.
        name: the name of the base, as reports show it: ``origin/main@9b1e44f``.
        revision: what it is a state of.
        files: the object of each file and link, by its path below the top, as git lists them.
        submodules: the commit of each, by its path; they are not in the copy.
        tip: the revision that was named, if HEAD lacks commits of it.
        newer: the object of each file that is another one in `tip`, by its path.
        notes: what is not as in a checkout of the base, a sentence each.
    """

    top: Path
    head_top: Path
    name: str
    revision: Revision
    files: Mapping[str, str]
    submodules: Mapping[str, str] = field(default_factory=dict)
    tip: str = ""
    newer: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def in_base(self, path: Path) -> Path | None:
        """Return the path in the base of a path in the head's tree; None outside of it."""
        try:
            return self.top / path.resolve().relative_to(self.head_top)
        except ValueError:
            return None

    def has_newer(self, path: str) -> bool:
        """Return True if the tip has another version of a file, which the head does not have."""
        wanted = self.newer.get(path)
        return wanted is not None and wanted != git.object_of(self.head_top, path)


@contextlib.contextmanager
def open_base_tree(text: str) -> Iterator[BaseTree]:
    """Yield the base of the repository that holds the working folder.

    Args:
        text: a revision. If HEAD lacks commits of it, the base is where HEAD left it.

    Raises:
        BaseRevisionError: there is no such revision, it is ambiguous, or it cannot be written.
    """
    head_top = git.find_work_tree(Path.cwd())
    if head_top is None:
        raise BaseRevisionError(
            f"the working folder is in no git repository: there is no base {clip(text)!r}",
            hint="Run it in the work tree of the change.",
        )
    tip = _named_commit(head_top, text)
    commit, notes = _merge_base(head_top, text, tip)
    name = re.sub("^refs/(heads|remotes|tags)/", "", text)
    revision = Revision(commit=commit, dirty=False, name=name)
    with contextlib.ExitStack() as stack:
        try:
            top = stack.enter_context(temporary_folder("base")).resolve() / "tree"
            # What looks for the top of a work tree finds it, although git finds no repository.
            (top / ".git").mkdir(parents=True)
        except OSError as error:
            raise _unwritable(Path(tempfile.gettempdir()), error) from error
        writer = _TreeWriter(head_top, commit, top)
        files = writer.write()
        later = _list_files(head_top, tip)[0] if tip != commit else ()
        yield BaseTree(
            top=top,
            head_top=head_top,
            name=revision_text(revision),
            revision=revision,
            files=files,
            submodules=writer.submodules,
            tip=f"{name}@{tip[:7]}" if tip != commit else "",
            newer={
                each.path: each.object_id
                for each in later
                if files.get(each.path) != each.object_id
            },
            notes=(*notes, *writer.notes()),
        )


def _named_commit(top: Path, text: str) -> str:
    """Return the commit that a text means.

    Raises:
        BaseRevisionError: git knows none, or several.
    """
    commits = git.commits_named(top, text)
    if len({*commits.values()}) > 1:
        places = (f"{name} is {commit[:12]}" for name, commit in commits.items() if name != text)
        raise BaseRevisionError(
            f"{clip(text)!r} is ambiguous: {', '.join(places)}",
            hint="Give its full name, such as refs/remotes/origin/main.",
        )
    if commits:
        return next(iter(commits.values()))
    raise _unknown_revision(top, text)


def _unknown_revision(top: Path, name: str) -> BaseRevisionError:
    """Return the error that git knows no such commit, with what to fetch, or what may be meant."""
    message, hint = f"git knows no revision {clip(name)!r}", HINT
    short = re.sub("^refs/(heads|remotes)/", "", name)
    remote, slash, branch = short.partition("/")
    shallow = git.output_of(top, "rev-parse", "--is-shallow-repository") == "true"
    depth = " --depth=1" if shallow else ""
    if shallow:
        message += ": this clone is shallow, and does not have it"
    if shallow and _COMMIT.fullmatch(name):
        hint = f"Fetch it first: git fetch{depth} origin {name}."
    elif slash and remote in git.output_of(top, "remote").split():
        hint = f"Fetch it first: git fetch{depth} {remote} {branch}:refs/remotes/{short}."
    if not shallow and (close := did_you_mean(short, git.ref_names(top))):
        message += f"; did you mean {close!r}?"
    return BaseRevisionError(message, hint=hint)


def _merge_base(top: Path, name: str, tip: str) -> tuple[str, list[str]]:
    """Return the commit to compare HEAD with, and what there is to say about it."""
    base = git.output_of(top, "merge-base", tip, "HEAD")
    # A shallow clone has no history, but HEAD itself names its parents.
    head = git.output_of(top, "cat-file", "commit", "HEAD")
    if base == tip or f"parent {tip}" in head.split("\n\n")[0].splitlines():
        return tip, []
    if not base:
        return tip, [f"This clone has no common commit of HEAD and {name}: {name} is the base."]
    lacking = pluralize(int(git.output_of(top, "rev-list", "--count", f"HEAD..{tip}")), "commit")
    return base, [f"HEAD lacks {lacking} of {name}: its base is {base[:7]}, where it branched off."]


@dataclass(frozen=True)
class _TreeEntry:
    """A file of a revision."""

    mode: int
    object_id: str
    path: str


class _TreeWriter:
    """Writes the files of a commit into an empty folder."""

    def __init__(self, top: Path, commit: str, folder: Path) -> None:
        self._top = top
        self._commit = commit
        self._folder = folder
        self.submodules: dict[str, str] = {}
        self._missing_lfs: list[str] = []
        # Linked work trees share the storage of the repository.
        common = git.output_of(top, "rev-parse", "--git-common-dir")
        self._lfs_objects = Path(top, common, "lfs/objects")

    def write(self) -> dict[str, str]:
        """Write all files; return their objects by path.

        Raises:
            BaseRevisionError: objects are missing, or the disk refuses.
        """
        entries, self.submodules = _list_files(self._top, self._commit)
        files = {entry.path: entry.object_id for entry in entries}
        for path in map(PurePosixPath, files):
            inside = {str(parent) for parent in path.parents} & files.keys()
            if inside or any(part == ".." or part.lower() == ".git" for part in path.parts):
                raise BaseRevisionError(
                    f"{self._commit[:12]} has the path {clip(str(path))!r}, which git would not "
                    "write",
                    hint="Compare with a commit whose paths git can check out.",
                )
        # Links last: no file is written through one.
        entries.sort(key=lambda entry: stat.S_ISLNK(entry.mode))
        try:
            self._write_objects(entries)
        except OSError as error:
            raise _unwritable(self._folder, error) from error
        return files

    def notes(self) -> Iterator[str]:
        """Yield what is not as in a checkout, a sentence each."""
        if self.submodules:
            yield f"Submodules are not in the base: {_listed(self.submodules)}."
        if self._missing_lfs:
            yield (
                f"Files of Git LFS are pointers in the base: {_listed(self._missing_lfs)}; "
                f"git lfs fetch origin {self._commit[:12]} gets them."
            )

    def _write_objects(self, entries: Iterable[_TreeEntry]) -> None:
        with tempfile.TemporaryFile() as names:
            names.write(b"".join(entry.object_id.encode() + b"\n" for entry in entries))
            names.seek(0)
            with subprocess.Popen(
                git.git_command(self._top, "cat-file", "--batch"),
                env=git.git_environment(),
                stdin=names,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            ) as process:
                assert process.stdout is not None  # noqa: S101 - it is a pipe
                try:
                    for entry in entries:
                        self._write_object(entry, process.stdout)
                except BaseException:
                    process.kill()
                    raise

    def _write_object(self, entry: _TreeEntry, objects: IO[bytes]) -> None:
        header = objects.readline().split()
        if len(header) != 3 or header[0].decode() != entry.object_id:
            raise _incomplete(self._commit, b" ".join(header))
        size, target = int(header[2]), self._folder / entry.path
        target.parent.mkdir(parents=True, exist_ok=True)
        if stat.S_ISLNK(entry.mode):
            target.symlink_to(os.fsdecode(self._read(objects, size)))
        else:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
            first = b""
            with os.fdopen(os.open(target, flags, 0o600 | entry.mode & 0o100), "wb") as file:
                while left := size - file.tell():
                    block = self._read(objects, min(left, _BLOCK_BYTES))
                    first = first or block
                    file.write(block)
            if size <= _MAX_POINTER_BYTES and (pointer := _LFS_POINTER.fullmatch(first)):
                self._take_lfs_object(target, entry, pointer[1].decode())
        objects.read(1)

    def _take_lfs_object(self, target: Path, entry: _TreeEntry, digest: str) -> None:
        """Put the content of a file of Git LFS in the place of its pointer, if it is here."""
        stored = self._lfs_objects / digest[:2] / digest[2:4] / digest
        for source in (stored, self._top / entry.path):
            if is_regular(source) and _sha256(source) == digest:
                shutil.copyfile(source, target)
                return
        self._missing_lfs.append(entry.path)

    def _read(self, source: IO[bytes], size: int) -> bytes:
        data = source.read(size)
        if len(data) != size:
            raise _incomplete(self._commit, b"git ended before it had given all objects")
        return data


def _list_files(top: Path, commit: str) -> tuple[list[_TreeEntry], dict[str, str]]:
    """Return the files and links of a commit, and the commits of its submodules by path.

    Raises:
        BaseRevisionError: the clone does not have its trees.
    """
    done = git.run_git(top, "ls-tree", "-r", "-z", "--full-tree", commit)
    if done is None or done.returncode:
        raise _incomplete(commit, done.stderr if done is not None else b"git does not answer")
    entries, submodules = [], {}
    for row in done.stdout.split(b"\0")[:-1]:
        description, _, name = row.partition(b"\t")
        mode, kind, object_id = description.decode().split()
        path = os.fsdecode(name)
        if kind == "commit":
            submodules[path] = object_id
        else:
            entries.append(_TreeEntry(int(mode, 8), object_id, path))
    return entries, submodules


def _incomplete(commit: str, said: bytes) -> BaseRevisionError:
    return BaseRevisionError(
        f"the repository lacks objects of {commit[:12]}: "
        f"{clip(said.decode(errors='replace').strip())}",
        hint="A partial clone does not have all files; fetch with git fetch --refetch, or "
        "clone without --filter.",
    )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _listed(paths: Iterable[str]) -> str:
    return first_words([clip(path) for path in paths], 5)


def _unwritable(folder: Path, error: OSError) -> BaseRevisionError:
    return BaseRevisionError(
        f"the files of the base cannot be written to {folder}: {error.strerror or error}",
        hint="Set TMPDIR to a folder on a disk with enough space.",
    )
