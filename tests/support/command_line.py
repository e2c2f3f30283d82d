"""The command line in this process, and what it says."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import pytest


class Said(NamedTuple):
    """What a call of r2bspec ended with, and what it printed."""

    status: int
    out: str
    err: str


class Call(Protocol):
    """Calls r2bspec; an exit status that is given is asserted."""

    def __call__(self, *arguments: object, status: int | None = None) -> Said: ...


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Call:
    """The command line; it is imported by the test that calls it."""
    from r2bspec.cli.main import main

    def called(*arguments: object, status: int | None = None) -> Said:
        capsys.readouterr()
        said = Said(main([str(argument) for argument in arguments]), *capsys.readouterr())
        assert status is None or said.status == status, said
        return said

    return called
