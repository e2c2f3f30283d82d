"""The base of a comparison: the argument of ``--against``, and the work tree that it names.

    REVISION            the same spec as a revision of git has it: a branch, a tag, a commit;
                        with three dots at its end, where the work tree branched off from it
    FOLDER              the same spec in another work tree
    SPEC                another spec, or a plan written by 'r2bspec plan'
    var:NAME=VALUE      the same spec with another value of a declared variable
    set:PATH=VALUE      the same spec with another value anywhere
    env:FILE            another workspace: its setup file, the folder of its installation,
    env:FOLDER          or a single variable of the environment
    env:NAME=VALUE

Several are combined: a spec and its variables, in an environment. Whether a revision exists is
asked of the repository that holds the spec, when the base is opened.

A revision is written from the objects of the repository, into a folder of its own outside of the
repository, which is removed at the end. Nothing that a repository can bring along is executed or
applied: no hook, no filter, no attribute, no configuration of a submodule; and nothing is fetched.
Files of Git LFS are taken from the local storage of the repository; what is not there stays the
pointer that git knows, and is named in a note.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import IO, BinaryIO

from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.quote import clip, first_words
from r2bspec.errors import UsageError
from r2bspec.language.secrets import shown_value
from r2bspec.record.graph_identity import Revision, revision_text
from r2bspec.safe_io import git
from r2bspec.safe_io.limits import MAX_TREE_BYTES, MAX_TREE_FILES
from r2bspec.safe_io.private_files import temporary_folder
from r2bspec.safe_io.safe_file import is_folder, is_regular, is_there

HINT = (
    "Give a revision of git such as origin/main, another work tree, a spec, var:NAME=VALUE, "
    "set:PATH=VALUE, or env: with a setup file, an installed workspace or NAME=VALUE."
)

_SPEC_SUFFIXES = (".yaml", ".yml", ".json")


class BadReferenceError(UsageError):
    """The argument of ``--against`` is not a base."""

    code = "R2B656"


@dataclass(frozen=True)
class BaseReference:
    """The base of a comparison, as given on the command line.

    Attributes:
        text: the arguments, joined, without the values of secrets.
        revision: what git calls the base; empty for none.
        folder: another work tree; None for none.
        spec: another spec or plan; None for that of the head.
        variables: values of variables that differ from the head's.
        sets: values that differ from the head's, each as ``path=value``.
        environments: read by `r2bspec.execute.processes.environment.workspace`, in order.
    """

    text: str
    revision: str = ""
    folder: Path | None = None
    spec: Path | None = None
    variables: Mapping[str, str] = field(default_factory=dict)
    sets: tuple[str, ...] = ()
    environments: tuple[str, ...] = ()

    @property
    def changes_spec(self) -> bool:
        """Whether the base has another spec, or other values, and not only an environment."""
        return bool(self.spec or self.variables or self.sets or self.has_tree)

    @property
    def has_tree(self) -> bool:
        """Whether the base has a work tree of its own, with its spec and its code."""
        return bool(self.revision) or self.folder is not None


def parse_base_reference(texts: Sequence[str]) -> BaseReference:
    """Parse the arguments of ``--against``.

    Raises:
        BadReferenceError: an argument is malformed, or a second spec, or does not exist.
    """
    bases: list[str] = []
    variables: dict[str, str] = {}
    sets: list[str] = []
    environments: list[str] = []
    for text in texts:
        kind, colon, rest = text.partition(":")
        if colon and kind in {"var", "set"}:
            name, equals, value = rest.partition("=")
            if not equals or not name:
                raise BadReferenceError(f"{kind}: takes NAME=VALUE, not {rest!r}", hint=HINT)
            if kind == "var":
                variables[name] = value
            else:
                sets.append(rest)
        elif colon and kind == "env":
            environments.append(rest)
        else:
            bases.append(text)
    if len(bases) > 1:
        raise BadReferenceError(
            f"only one base is possible: {bases[0]} or {bases[1]}",
            hint="Compare with each of them in a run of its own.",
        )
    reference = BaseReference(
        text=", ".join(map(_shown, texts)),
        variables=variables,
        sets=tuple(sets),
        environments=tuple(environments),
    )
    return _with_base(reference, bases[0]) if bases else reference


def _with_base(reference: BaseReference, text: str) -> BaseReference:
    """A reference with a spec, a work tree, or what may be a revision."""
    path = Path(text)
    if text and is_regular(path):
        return replace(reference, spec=path)
    if is_there(path / "record.json") or is_there(path / "pairs.json"):
        raise BadReferenceError(
            f"{text!r} is a stored run: it cannot be a base",
            hint="A stored run cannot be played again; 'r2bspec compare' compares finished runs.",
        )
    if text and is_folder(path):
        return replace(reference, folder=path)
    if not text or text.endswith(_SPEC_SUFFIXES):
        raise BadReferenceError(f"{text!r} does not exist: it cannot be a base", hint=HINT)
    return replace(reference, revision=text)


def _shown(text: str) -> str:
    """A reference as it may be shown: one that sets a secret, without its value."""
    name, equals, value = text.removeprefix("env:").partition("=")
    return f"env:{name}={shown_value(name, value)}" if text.startswith("env:") and equals else text


_TREE = "tree"

_BLOCK_BYTES = 1 << 20

_LFS_POINTER = re.compile(
    rb"version https://git-lfs\.github\.com/spec/v1\n(?:ext-.*\n)*"
    rb"oid sha256:([0-9a-f]{64})\nsize (\d{1,15})\n"
)
_MAX_POINTER_BYTES = 1024
_COMMIT = re.compile("[0-9a-f]{40}")
_BRANCH = re.compile(r"(?![0-9a-f]{7,40}$)[A-Za-z][\w.-]*")


class BaseRevisionError(UsageError):
    """The base of a gate cannot be had as files."""

    code = "R2B694"
    way_out = "Give --against a commit that 'git worktree add' can check out, or a work tree."


@dataclass(frozen=True)
class BaseTree:
    """The work tree of the base.

    Attributes:
        top: its folder.
        head_top: the top of the work tree of the head, which has the same layout.
        name: of the base, as reports show it: ``origin/main@9b1e44f``.
        revision: what it is a state of; None if that is not known.
        notes: what is not as in a checkout, a sentence each.
    """

    top: Path
    head_top: Path
    name: str
    revision: Revision | None
    notes: tuple[str, ...] = ()

    def in_base(self, path: Path) -> Path | None:
        """Where the base has a path of the head's tree; None for a path outside of it."""
        try:
            return self.top / path.resolve().relative_to(self.head_top)
        except ValueError:
            return None


@contextlib.contextmanager
def open_base_tree(reference: BaseReference, spec: Path) -> Iterator[BaseTree]:
    """The work tree of a base, while the context lasts.

    Args:
        reference: has a revision or a folder.
        spec: of the head, or its folder; a file of the repository.

    Raises:
        BaseRevisionError: there is no such revision, or it cannot be written.
    """
    folder = spec if spec.is_dir() else spec.parent
    head_top = git.find_work_tree(folder)
    if reference.folder is not None:
        yield _other_work_tree(reference.folder.resolve(), head_top or folder.resolve())
        return
    if head_top is None:
        raise BaseRevisionError(
            f"{clip(reference.revision)!r} is neither a file nor a folder, and {folder} is in no "
            "git repository that could know it as a revision",
            hint=HINT,
        )
    commit = _commit(head_top, reference.revision)
    revision = Revision(commit=commit, dirty=False, name=reference.revision.removesuffix("..."))
    with contextlib.ExitStack() as stack:
        try:
            place = stack.enter_context(temporary_folder("base"))
        except OSError as error:
            raise _unwritable(Path(tempfile.gettempdir()), error) from error
        (place / _TREE).mkdir()
        # What looks for the top of a work tree finds it, although git finds no repository.
        (place / _TREE / ".git").mkdir()
        notes = _TreeWriter(head_top, commit, place / _TREE).write()
        yield BaseTree(
            # As `resolve` names it: files that processes load are compared with it.
            top=(place / _TREE).resolve(),
            head_top=head_top,
            name=revision_text(revision),
            revision=revision,
            notes=notes,
        )


def _other_work_tree(folder: Path, head_top: Path) -> BaseTree:
    """A work tree that exists; it is used as it is."""
    top = git.find_work_tree(folder) or folder
    if top == head_top:
        raise BaseRevisionError(
            f"{folder} is in the work tree of the head",
            hint="Give another work tree, such as one of git worktree add, or a revision.",
        )
    state = git.inspect_work_tree(top)
    if state is None or not state.commit:
        return BaseTree(top=top, head_top=head_top, name=folder.name, revision=None)
    revision = Revision(commit=state.commit, dirty=bool(state.changed), name=folder.name)
    return BaseTree(top=top, head_top=head_top, name=revision_text(revision), revision=revision)


def _commit(top: Path, text: str) -> str:
    """The commit that a text means.

    Raises:
        BaseRevisionError: git knows none.
    """
    name = text.removesuffix("...")
    commit = git.commit_of(top, name)
    if commit is not None and name != text:
        commit = _output(top, "merge-base", commit, "HEAD") or None
    if commit is not None:
        return commit
    raise _unknown_revision(top, name, branched_off=name != text)


def _unknown_revision(top: Path, name: str, *, branched_off: bool) -> BaseRevisionError:
    """The error that git does not know a commit, with the name that may be meant."""
    shallow = _output(top, "rev-parse", "--is-shallow-repository") == "true"
    known = git.commit_of(top, name) is not None
    message = f"git knows no revision {name!r}"
    if branched_off and known:
        message = f"git finds no commit from which HEAD and {name!r} branched off"
    if shallow:
        message += ": this clone is shallow, and does not have it"
    fetch = _fetch_of(top, name, shallow=shallow, branched_off=branched_off)
    # What a shallow clone has is the change itself: nothing to compare it with.
    if not known and not (fetch and shallow) and (close := _similar_ref(top, name)):
        message += f"; did you mean {close!r}?"
    way_out = f"Fetch it first: {fetch}. The base can also be a work tree, or a spec."
    return BaseRevisionError(message, hint=way_out if fetch else HINT)


def _similar_ref(top: Path, name: str) -> str:
    """The branch or tag that may be meant: the same one of another place, or a similar name."""
    refs = [ref for ref in git.ref_names(top) if not ref.endswith("/HEAD")]
    branch = name.rpartition("/")[2]
    elsewhere = next((ref for ref in refs if ref.rpartition("/")[2] == branch), "")
    similar = did_you_mean(name, refs)
    return similar or elsewhere if "/" in name else elsewhere or similar


def _fetch_of(top: Path, name: str, *, shallow: bool, branched_off: bool) -> str:
    """The command that gets a revision which this clone left out; empty if it left none out."""
    depth = " --unshallow" if shallow and branched_off else " --depth=1" if shallow else ""
    remote, slash, branch = name.partition("/")
    remotes = _output(top, "remote").split()
    if not slash and remotes and _BRANCH.fullmatch(name) and git.commit_of(top, name) is None:
        there = f"{remotes[0]}/{name}"
        if not shallow or git.commit_of(top, there) is not None:
            return ""
        return f"git fetch{depth} {remotes[0]} {name}:refs/remotes/{there}, and name it {there}"
    if slash and remote in remotes:
        fetched = _output(top, "config", "--get-all", f"remote.{remote}.fetch").split()
        has_all = any("refs/heads/*:" in refspec for refspec in fetched)
        return (
            f"git fetch{depth} {remote} {branch}:refs/remotes/{name}"
            if shallow or not has_all
            else ""
        )
    if shallow and git.commit_of(top, name) is not None:
        return f"git fetch{depth}"
    return f"git fetch{depth} origin {name}" if shallow and _COMMIT.fullmatch(name) else ""


def _output(top: Path, *arguments: str) -> str:
    """What git prints; empty if it fails."""
    done = git.run_git(top, *arguments)
    return done.stdout.decode(errors="replace").strip() if done and done.returncode == 0 else ""


@dataclass(frozen=True)
class _TreeEntry:
    """A file of a revision: its mode and object, the size of that, and its path."""

    mode: int
    object_id: str
    size: int
    path: str


class _TreeWriter:
    """Writes the files of a commit into an empty folder."""

    def __init__(self, top: Path, commit: str, folder: Path) -> None:
        self._top = top
        self._commit = commit
        self._folder = folder
        self._missing_lfs: list[str] = []
        # Linked work trees share the storage of the repository.
        self._lfs_objects = Path(top, _output(top, "rev-parse", "--git-common-dir"), "lfs/objects")

    def write(self) -> tuple[str, ...]:
        """Write all of them; returns what is not as in a checkout.

        Raises:
            BaseRevisionError: objects are missing, or the disk refuses.
        """
        entries, submodules = self._entries()
        files = [entry for entry in entries if stat.S_ISREG(entry.mode)]
        links = [entry for entry in entries if stat.S_ISLNK(entry.mode)]
        self._check_space(sum(entry.size for entry in files))
        try:
            # Links last: nothing is written through one, whatever the tree contains.
            self._write_objects(files)
            self._write_objects(links)
        except OSError as error:
            raise _unwritable(self._folder, error) from error
        notes = []
        if submodules:
            notes.append(f"Submodules are empty in the base: {_named(submodules)}.")
        if self._missing_lfs:
            notes.append(
                f"Files of Git LFS are not in this clone, and are pointers in the base: "
                f"{_named(self._missing_lfs)}; git lfs fetch origin {self._commit[:12]} gets them."
            )
        return tuple(notes)

    def _entries(self) -> tuple[list[_TreeEntry], list[str]]:
        done = git.run_git(self._top, "ls-tree", "-r", "-l", "-z", "--full-tree", self._commit)
        if done is None or done.returncode:
            raise self._incomplete(done.stderr if done is not None else b"git does not answer")
        entries, submodules = [], []
        paths: set[str] = set()
        for row in done.stdout.split(b"\0")[:-1]:
            description, _, name = row.partition(b"\t")
            mode, kind, object_id, size = description.split()
            path = os.fsdecode(name)
            if kind == b"commit":
                submodules.append(path)
                continue
            parts = PurePosixPath(path).parts
            hostile = path.startswith("/") or any(
                part == ".." or part.lower() == ".git" for part in parts
            )
            if hostile or path in paths:
                raise BaseRevisionError(
                    f"{self._commit[:12]} has the path {clip(path)!r}, which git would not write"
                )
            paths.add(path)
            length = int(size) if size.isdigit() else 0
            entries.append(_TreeEntry(int(mode, 8), object_id.decode(), length, path))
            if len(entries) > MAX_TREE_FILES:
                raise BaseRevisionError(f"{self._commit[:12]} has over {MAX_TREE_FILES:,} files")
        return entries, submodules

    def _check_space(self, needed: int) -> None:
        free = shutil.disk_usage(self._folder).free
        if needed > min(free, MAX_TREE_BYTES):
            raise _unwritable(
                self._folder,
                OSError(errno.ENOSPC, f"{needed:,} bytes are needed, and {free:,} are free"),
            )

    def _write_objects(self, entries: Sequence[_TreeEntry]) -> None:
        if not entries:
            return
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
            raise self._incomplete(b" ".join(header))
        size = int(header[2])
        target = self._folder / entry.path
        target.parent.mkdir(parents=True, exist_ok=True)
        if stat.S_ISLNK(entry.mode):
            target.symlink_to(os.fsdecode(_read(objects, size)))
        else:
            first = _read(objects, min(size, _BLOCK_BYTES))
            with self._own_file(target, entry.mode) as file:
                file.write(first)
                left = size - len(first)
                while left:
                    block = _read(objects, min(left, _BLOCK_BYTES))
                    file.write(block)
                    left -= len(block)
            if size <= _MAX_POINTER_BYTES and (pointer := _LFS_POINTER.fullmatch(first)):
                self._take_lfs_object(target, entry, pointer[1].decode())
        objects.read(1)

    @staticmethod
    def _own_file(target: Path, mode: int) -> BinaryIO:
        permissions = 0o700 if mode & 0o100 else 0o600
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
        return os.fdopen(os.open(target, flags, permissions), "wb")

    def _take_lfs_object(self, target: Path, entry: _TreeEntry, digest: str) -> None:
        """Put the content of a file of Git LFS in the place of its pointer, if it is here."""
        stored = self._lfs_objects / digest[:2] / digest[2:4] / digest
        if not stored.is_file():
            self._missing_lfs.append(entry.path)
            return
        found = hashlib.sha256()
        with stored.open("rb") as source, target.open("wb") as file:
            while block := source.read(_BLOCK_BYTES):
                found.update(block)
                file.write(block)
        if found.hexdigest() != digest:
            raise BaseRevisionError(
                f"the file of Git LFS for {clip(entry.path)} is damaged in this clone",
                hint="Remove it from .git/lfs/objects, and fetch it again: git lfs fetch.",
            )

    def _incomplete(self, said: bytes) -> BaseRevisionError:
        return BaseRevisionError(
            f"the repository lacks objects of {self._commit[:12]}: "
            f"{clip(said.decode(errors='replace').strip())}",
            hint="A partial clone does not have all files; fetch with git fetch --refetch, or "
            "clone without --filter.",
        )


def _read(source: IO[bytes], size: int) -> bytes:
    data = source.read(size)
    if len(data) != size:
        raise BaseRevisionError("git ended before it had given all objects")
    return data


def _named(paths: Iterable[str]) -> str:
    return first_words([clip(path) for path in paths], 5)


def _unwritable(folder: Path, error: OSError) -> BaseRevisionError:
    return BaseRevisionError(
        f"the work tree of the base cannot be written to {folder}: {error.strerror or error}",
        hint="Set TMPDIR to a folder on a disk with enough space.",
    )
