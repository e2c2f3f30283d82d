"""The command that installs an extra of the package, for hints."""

from __future__ import annotations

import json
from urllib.parse import unquote, urlsplit


def install_command(extra: str) -> str:
    """Return the command that installs an extra from where the package was installed.

    A package that was installed from a folder or a repository has that in direct_url.json
    (https://peps.python.org/pep-0610/); an index may not have the package.
    """
    # Every process of a run imports this module, and reads no metadata.
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        origin = json.loads(distribution("r2bspec").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        origin = {}
    url = origin.get("url", "")
    if "vcs_info" in origin:
        return f"pip install 'r2bspec[{extra}] @ {origin['vcs_info'].get('vcs', 'git')}+{url}'"
    if url.startswith("file:"):
        return f"pip install '{unquote(urlsplit(url).path)}[{extra}]'"
    return f"pip install 'r2bspec[{extra}]'"
