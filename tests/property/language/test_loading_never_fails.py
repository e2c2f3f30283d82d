"""Whatever the bytes, loading ends with a spec or with a reason, and never with a traceback."""

from __future__ import annotations

from pathlib import Path

import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from nightly import size
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.language.located_tree import TreeNode, to_plain
from r2bspec.language.yaml_document import to_yaml
from r2bspec.report.finding_formats import FORMATS, render

GOLDEN = sorted((Path(__file__).parents[2] / "golden" / "language").glob("*.yaml"))
SPECS = [file.read_bytes() for file in GOLDEN]
PIECES = [
    b"\t", b"\n", b"  ", b"- ", b": ", b":", b"#", b"'", b'"', b"[", b"]", b"{", b"}", b",", b"&a ",
    b"*a", b"<<: *a", b"!!x ", b"---\n", b"...\n", b"|\n", b">\n", b"\\", b"@", b"%", b"\x00",
    b"\xff", b"\xef\xbb\xbf", b"\xe2\x80\xa8", b"\r\n", b"null", b"true", b"0x1", b"1e999", b"-1",
    b"30 Hz", b"$(var rate)", b"$(", b"$(env X)", b"9" * 40, b"x-a: 1", "é画".encode(),
]  # fmt: skip


@settings(max_examples=size(37, 150))
@given(st.text())
@example("\ud800")
@example("a: \ud800\n")
@example("\x85a: [\u2028")
def test_any_text(content: str) -> None:
    _holds(load_spec(content))


@settings(max_examples=size(25, 100))
@given(st.binary())
def test_any_bytes(content: bytes) -> None:
    _holds(load_spec(content))


@settings(max_examples=size(100, 400))
@given(st.sampled_from(SPECS), st.data())
def test_mutated_specs(content: bytes, data: st.DataObject) -> None:
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(content)))
        end = min(start + data.draw(st.integers(0, 12)), len(content))
        piece = data.draw(st.sampled_from([b"", *PIECES]))
        content = content[:start] + piece + content[end:]
    _holds(load_spec(content, environ={"X": "1"}))


@settings(max_examples=size(50, 200))
@given(st.sampled_from(SPECS), st.data())
def test_lines_swapped_and_repeated(content: bytes, data: st.DataObject) -> None:
    lines = content.splitlines(keepends=True) or [b""]
    order = data.draw(st.lists(st.sampled_from(range(len(lines))), max_size=len(lines) + 3))
    _holds(load_spec(b"".join(lines[index] for index in order)))


@settings(max_examples=size(25, 100))
@given(st.text(max_size=40), st.text(max_size=20))
@example("benchmark.rates[0]=[1 Hz", "x")
@example("slos['fast'].at={a: b", "")
@example("=", "=")
def test_options(option: str, value: str) -> None:
    spec = GOLDEN[0].with_name("ok_minimal.yaml").read_bytes()
    loaded = load_spec(spec, sets=[option, f"name={value}"], variables={"rate": value})
    _renders(loaded)
    assert loaded.spec is None  # the variable is not declared


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-3, 10)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.sampled_from(["", "x", "1", "30 Hz", "2 %", "1 s", "a/b", "a.B", "p/msg/T", "sustained"])
    | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["a", "python", "from", "format", "x-y", "0", "/t"]), inner
        )
    ),
    max_leaves=6,
)


@settings(max_examples=size(100, 400))
@given(st.data(), VALUES)
def test_any_value_anywhere(data: st.DataObject, value: object) -> None:
    document = to_plain(composed_tree("ok_full.yaml"))
    place = document
    while True:
        keys = sorted(place) if isinstance(place, dict) else list(range(len(place)))
        key = data.draw(st.sampled_from(keys))
        if not isinstance(place[key], dict | list) or not place[key] or data.draw(st.booleans()):
            break
        place = place[key]
    place[key] = value
    _holds(load_spec(to_yaml(document)))


@settings(max_examples=size(100, 1_000))
@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=200))
@example("@\x85")
def test_what_is_written_is_read_back(text: str) -> None:
    assert yaml.safe_load(to_yaml([text, {text: 0}])) == [text, {text: 0}]


def composed_tree(name: str) -> TreeNode:
    tree = load_spec((GOLDEN[0].parent / name).read_bytes()).tree
    assert tree is not None
    return tree


def _holds(loaded: LoadedSpec) -> None:
    errors = [found for found in loaded.diagnostics if found.severity == "error"]
    assert (loaded.spec is None) == bool(errors)
    assert "R2B199" not in {found.code for found in errors}
    _renders(loaded)
    for path in ((), ("benchmark", "rates", 0), ("graph", "nodes", "relay", "x")):
        loaded.span(path)
        loaded.span(path, key=True)
        loaded.span_inside(path, 3, 2)
    if loaded.spec is not None:
        assert load_spec(loaded.resolved_yaml()).spec == loaded.spec


def _renders(loaded: LoadedSpec) -> None:
    for name in FORMATS:
        render(name, loaded.diagnostics, loaded.texts).encode()
