"""What must hold for any bytes."""

from __future__ import annotations

from r2bspec.check import check
from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.diagnostics.edits import fix
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.report.finding_formats import FORMATS, render

FILE = "fuzz.r2b.yaml"
ENVIRON = {"HOME": "/home/someone"}


def check_bytes(data: bytes) -> None:
    """Load, check, render and repair.

    Raises:
        AssertionError: something does not hold. Any other exception is a failure, too.
    """
    loaded = _load(data)
    found = check(loaded, offline=True)
    errors = [one for one in loaded.diagnostics if one.severity is Severity.ERROR]
    assert (loaded.spec is None) == bool(errors), "a spec, or a reason why there is none"
    _inside(loaded, found)
    for name in FORMATS:
        render(name, found, loaded.texts).encode()
    if loaded.spec is not None:
        again = load_spec(loaded.resolved_yaml(), file=FILE, environ=ENVIRON)
        assert again.spec == loaded.spec, "the resolved document means the same"
    _repair(loaded)


def _load(data: bytes | str) -> LoadedSpec:
    return load_spec(data, file=FILE, environ=ENVIRON)


def _inside(loaded: LoadedSpec, found: list[Diagnostic]) -> None:
    source = loaded.sources[FILE]
    for one in found:
        span = one.span
        assert one.message, "a finding says something"
        assert 1 <= span.line <= span.end_line, span
        assert span.line <= len(source.lines) + 1, span
        assert span.column >= 1, span


def _repair(loaded: LoadedSpec) -> None:
    if any(one.edit is not None for one in loaded.diagnostics):
        before = loaded.sources[FILE].text
        fixed = fix(before, FILE, lambda changed: check(_load(changed), offline=True))
        assert fixed.applied or fixed.text == before, "nothing changes without a finding"
