"""The user's cache: programs, datasets and indexes of recordings that are kept between calls.

What is kept is believed. So a cache is used only where no other user but root can change it, or
exchange a folder above it, and where no commit can bring it along: in no work tree of git. Any
other is passed over, and so is one that cannot be made.

An archive can bring a cache along, too, and nothing tells where it was unpacked. But it brings no
`FileState`, so a file that is believed without a look into it is kept with its own.
"""

from __future__ import annotations

import grp
import os
import pwd
import stat
from pathlib import Path
from typing import Final

from r2bspec.safe_io.private_files import private_files

FileState = tuple[int, int, int, int]
"""Inode, size, and when content (mtime) and file (ctime) last changed, in nanoseconds.

A program can set the first time to any value, but not the second."""


def file_state(status: os.stat_result) -> FileState:
    """What the kernel alone decides about a file, and changes whenever it is written."""
    return (status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)


_ACL: Final = "system.posix_acl_access"

passed_over: list[str] = []
"""What to tell the user about caches that this process does not use, a sentence each."""


class UnusableCacheError(OSError):
    """A cache that this process does not use; `strerror` says why."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.strerror = reason


def cache_path(kind: str) -> Path:
    """Where one kind of what is kept lies: in ``$XDG_CACHE_HOME``, or in ``~/.cache``."""
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    # Without a home, the tilde stays; `Path.expanduser` would raise.
    base = named if named.is_absolute() else Path(os.path.expanduser("~/.cache"))  # noqa: PTH111
    return base / "r2bspec" / kind


def cache_folder(kind: str) -> Path:
    """The folder of one kind of what is kept; see `believed_folder`."""
    folder = cache_path(kind)
    if not folder.is_absolute():
        raise UnusableCacheError("this user has no home folder")
    return believed_folder(folder)


def believed_folder(folder: Path) -> Path:
    """A folder whose content is believed, without links; it is made.

    Raises:
        OSError: it cannot be made, or is not to be believed (`UnusableCacheError`).
    """
    with private_files():
        folder.mkdir(parents=True, exist_ok=True)
    # The check goes over the folders that a path leads through in the end.
    folder = folder.resolve(strict=True)
    if reason := distrust(folder):
        raise UnusableCacheError(reason)
    return folder


def distrust(folder: Path) -> str:
    """Why what lies in a folder is not believed; empty if it is.

    Args:
        folder: without links, as `Path.resolve` gives it.
    """
    from r2bspec.safe_io.git import find_work_tree

    if top := find_work_tree(folder):
        return f"{top} is a work tree of git, and a commit can have filled it"
    return exposed_by(folder)


def cache_or_temporary_folder(kind: str) -> Path:
    """The same; in place of a cache that is not used, a folder that ends with this process."""
    try:
        return cache_folder(kind)
    except OSError as error:
        pass_over(kind, error)
        from r2bspec.safe_io.private_files import process_folder

        return process_folder(kind)


def pass_over(kind: str, error: OSError) -> None:
    """Let the user know, once, that a cache is not used."""
    text = (
        f"note: the cache {cache_path(kind)} is not used: {error.strerror or error}; each call "
        "makes anew what it would keep (XDG_CACHE_HOME names another folder)"
    )
    if text not in passed_over:
        passed_over.append(text)


def exposed_by(path: Path) -> str:
    """By what another user than root can change a file or folder, or exchange it.

    From the root downwards: a folder that nobody can exchange, in one that nobody can exchange,
    stays what it is while the rest is looked at.

    Args:
        path: without links, as `Path.resolve` gives it.

    Returns:
        The reason; empty if nobody can.

    Raises:
        OSError: it is not there.
    """
    for place in (*reversed(path.parents), path):
        status = place.lstat()
        if stat.S_ISLNK(status.st_mode):
            return f"{place} is a link"
        if status.st_uid not in {0, os.geteuid()}:
            return f"{place} belongs to another user"
        # In a sticky folder, nobody can exchange what is another user's.
        if status.st_mode & stat.S_ISVTX and place != path:
            continue
        by_group = status.st_mode & stat.S_IWGRP and not _is_private_group(place, status.st_gid)
        if status.st_mode & stat.S_IWOTH or by_group:
            return f"other users can write to {place}"
    return ""


def _is_private_group(place: Path, group_id: int) -> bool:
    """Whether a group has this user alone, as where the umask is 002, and the mode tells all."""
    try:
        user, group = pwd.getpwuid(os.geteuid()), grp.getgrgid(group_id)
        return (
            (group.gr_gid, group.gr_name) == (user.pw_gid, user.pw_name)
            and {*group.gr_mem} <= {user.pw_name}
            and _ACL not in os.listxattr(place)
        )
    except (KeyError, OSError):
        return False
