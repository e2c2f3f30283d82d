"""ROS packages that are installed for a test, as ament installs them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from git_repositories import write_files


def install_package(
    prefix: Path,
    package: str,
    files: Mapping[str, str] | None = None,
    programs: Iterable[str] = (),
    **resources: str,
) -> Path:
    """Install a package below a prefix, which is returned.

    Args:
        prefix: the folder.
        package: the name.
        files: texts by their paths in the folder of the package below ``share``.
        programs: the names of its executables.
        resources: what the index has of the package besides its name, by the kind.
    """
    index = {"packages": "", **resources}
    write_files(
        prefix,
        {f"share/ament_index/resource_index/{kind}/{package}": text for kind, text in index.items()}
        | {f"share/{package}/{path}": text for path, text in (files or {}).items()}
        | {f"lib/{package}/{name}": "#!/bin/sh\n" for name in programs},
    )
    for name in programs:
        (prefix / "lib" / package / name).chmod(0o755)
    return prefix
