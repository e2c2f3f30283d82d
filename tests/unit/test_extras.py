"""Hints say how an extra is installed from where the package was."""

from __future__ import annotations

from importlib import metadata
from typing import Any

import pytest

from r2bspec.extras import install_command


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, "pip install 'r2bspec[ros]'"),
        ("{", "pip install 'r2bspec[ros]'"),
        (
            '{"url": "file:///srv/my%20code/r2bspec", "dir_info": {"editable": true}}',
            "pip install '/srv/my code/r2bspec[ros]'",
        ),
        (
            '{"url": "https://example.org/r2bspec.git", "vcs_info": {"vcs": "git"}}',
            "pip install 'r2bspec[ros] @ git+https://example.org/r2bspec.git'",
        ),
    ],
)
def test_an_extra_comes_from_where_the_package_came_from(
    monkeypatch: pytest.MonkeyPatch, origin: str | None, command: str
) -> None:
    class Installed:
        def read_text(self, _: str) -> str | None:
            return origin

    monkeypatch.setattr("importlib.metadata.distribution", lambda _: Installed())
    assert install_command("ros") == command


def test_a_package_that_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> Any:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.distribution", absent)
    assert install_command("tune") == "pip install 'r2bspec[tune]'"
