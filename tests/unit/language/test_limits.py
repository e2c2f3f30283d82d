"""Documents made to hurt: each is answered, in bounded time; for memory, see tests/fuzz."""

from __future__ import annotations

from pathlib import Path

import pytest

from nightly import size
from r2bspec.language import yaml_document as composing
from r2bspec.language.load_spec import load_spec
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES


@pytest.mark.parametrize(
    "content", [b"a" * (MAX_DOCUMENT_BYTES + 1), "a" * (MAX_DOCUMENT_BYTES + 1)]
)
def test_a_large_document_is_refused(content: str | bytes) -> None:
    assert [found.code for found in load_spec(content).diagnostics] == ["R2B002"]


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    "content",
    [
        "".join(f"key{i}: 1\n" for i in range(20_000)),
        "key: 1\n" * 20_000,
        "benchmark: {rates: [" + "1," * 20_000 + "]}",
        "variables: {x: 1}\ntitle: '" + "$(var y)" * 20_000 + "'",
        "title: '" + "$(var " * 20_000 + "'",
    ],
    ids=["unknown", "twice", "units", "unset", "unclosed"],
)
def test_many_mistakes_are_cut_off(content: str) -> None:
    found = load_spec(content).diagnostics
    assert len(found) in (1000, 1001, 1002)


def test_shared_values_are_not_copied() -> None:
    loaded = load_spec("x: &x [" + "1," * 1000 + "]\ny: [" + "*x," * 100 + "]\n")
    assert "R2B027" not in {found.code for found in loaded.diagnostics}


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "missing.r2b.yaml"):
        (found,) = load_spec(path).diagnostics
        assert found.code == "R2B001"


def test_the_python_parser_is_good_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    golden = Path(__file__).parents[2] / "golden" / "language"
    files = sorted(golden.glob("*.yaml"))[:: size(3, 1)]
    native = [load_spec(file) for file in files]
    monkeypatch.setattr(composing, "_CParser", None)
    for file, expected in zip(files, native, strict=True):
        loaded = load_spec(file)
        assert loaded.spec == expected.spec
        assert [diagnostic.code for diagnostic in loaded.diagnostics] == [
            diagnostic.code for diagnostic in expected.diagnostics
        ], file.name
