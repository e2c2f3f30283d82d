"""Documents made to break a reader: each is answered by a finding, in bounded memory."""

from __future__ import annotations

import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from hostile_calls import LONGEST_S, make_special, r2bspec

from nightly import sampled
from r2bspec.report.findings_text import code_with_slug

MEMORY_BYTES = 600_000_000
"""Address space, of which the interpreter with its libraries takes about a third."""

pytestmark = pytest.mark.timeout(LONGEST_S + 30)

MINIMAL = """\
r2bspec: 1
name: minimal
data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: image_raw}}
playback: {inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}}
graph: {nodes: {relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}}}
monitors: {output: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {rates: [30 Hz]}
"""


def _bomb(levels: int) -> str:
    first = "x-0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"
    rest = (f"x-{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, levels))
    return MINIMAL + first + "".join(rest)


def _quadratic_merge() -> str:
    keys = ", ".join(f"k{i}: 1" for i in range(2000))
    merges = "\n".join(f"  m{i}: {{<<: *x}}" for i in range(2000))
    return f"{MINIMAL}x-a: &x {{{keys}}}\nx-b:\n{merges}\n"


TEXTS: dict[str, tuple[str | bytes, str]] = {
    "alias bomb": (_bomb(30), "R2B027"),
    "alias bomb in a known key": (_bomb(8).replace("x-7:", "labels:"), "R2B027"),
    "merge bomb": (_quadratic_merge(), "R2B027"),
    "lists 10,000 deep": (MINIMAL + "labels: " + "[" * 10_000, "R2B025"),
    "maps 10,000 deep": (MINIMAL + "labels: " + "{a: " * 10_000, "R2B025"),
    "dashes 10,000 deep": (MINIMAL + "labels:\n  " + "- " * 10_000, "R2B025"),
    "indented 2,000 deep": ("\n".join(" " * n + "a:" for n in range(2000)), "R2B025"),
    "closed brackets 10,000 deep": ("[" * 10_000 + "]" * 10_000, "R2B025"),
    "extends itself": (MINIMAL + "extends: ./hostile.r2b.yaml\n", "R2B135"),
    "extends a device": (MINIMAL + "extends: /dev/zero\n", "R2B13"),
    "extends very many": (MINIMAL + f"extends: [{'./none.r2b.yaml, ' * 20_000}]\n", "R2B13"),
    "a matrix without end": (
        MINIMAL
        + "variables: {a: 1, b: 1, c: 1, d: 1, e: 1, f: 1}\nmatrix:\n  axes:\n"
        + "".join(f"    {name}: [{', '.join(map(str, range(100)))}]\n" for name in "abcdef"),
        "R2B1",
    ),
    "only NUL": ("\0" * 100_000, "R2B003"),
    "a lone surrogate in bytes": (MINIMAL.encode() + b"title: \xed\xa0\x80\n", "R2B003"),
    "a thousand documents": ("---\n" * 1000, "R2B021"),
    "a huge number": (MINIMAL + f"labels: {{a: {'9' * 1_000_000}}}\n", "R2B029"),
    "a huge quantity": (MINIMAL.replace("30 Hz", "1e999999999 Hz"), "R2B110"),
    "many digits of a quantity": (MINIMAL.replace("30 Hz", f"{'9' * 100_000} Hz"), "R2B11"),
    "blanks": (" \n" * 100_000, "R2B020"),
    "comments": ("# nothing\n" * 100_000, "R2B020"),
    "a scalar": ("x" * 1_000_000, "R2B103"),
    "a list": ("- a\n" * 10_000, "R2B103"),
    "an endless line": (MINIMAL + "title: [" + "x " * 1_000_000, "R2B012"),
    "very many unknown keys": ("".join(f"k{i}: 1\n" for i in range(100_000)), "R2B101"),
    "too many keys": ("".join(f"k{i}: 1\n" for i in range(300_000)), "R2B002"),
    "comments above comments": (MINIMAL + "# r2bspec: ignore[R2B999] x\n" * 20_000, "R2B041"),
    "a key of a megabyte": (MINIMAL + "x" * 1_000_000 + ": 1\n", "R2B"),
    "text inserted without end": (
        f"{MINIMAL}variables: {{a: {'x' * 100_000}}}\ntitle: {'$(var a)' * 10_000}\n",
        "R2B129",
    ),
    "a waiver on every line": (
        MINIMAL
        + "labels:\n"
        + "".join(f"  k{i}: 1 # r2bspec: ignore[R2B999] x\n" for i in range(5000)),
        "R2B041",
    ),
    "a requirement that never ends": (
        MINIMAL + f"slos: {{a: {{at: 30 Hz, require: ['{'latency.' * 50_000}']}}}}\n",
        "R2B112",
    ),
}
"""Small mistakes are in tests/golden/language, with the words that are said about them."""


def validate(file: Path, *options: str, stdin: bytes = b"") -> str:
    """What validate prints in little memory; anything but an answer is a failure."""
    words: tuple[str | Path, ...] = ("validate", "--offline", *options, file)
    status, said = r2bspec(*words, cwd=Path.cwd(), memory_bytes=MEMORY_BYTES, stdin=stdin)
    assert status in (0, 1), said
    return said


@pytest.mark.parametrize("name", TEXTS)
def test_a_hostile_text_is_answered(name: str, tmp_path: Path) -> None:
    text, code = TEXTS[name]
    file = tmp_path / "hostile.r2b.yaml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    said = validate(file)
    assert re.search(rf"^\S*hostile.r2b.yaml:\d+:\d+: \w+\[{code}", said, re.MULTILINE), said[:2000]
    assert max(map(len, said.splitlines())) < 2000


@pytest.mark.parametrize(
    ("kind", "code"), [("large", "R2B002"), ("terabyte", "R2B002"), ("itself", "R2B001")]
)
def test_a_hostile_file_is_answered(kind: str, code: str, tmp_path: Path) -> None:
    file = tmp_path / "hostile.r2b.yaml"
    if kind == "large":
        file.write_bytes(MINIMAL.encode() + b"# x\n" * 25_000_000)
    else:
        make_special(file, kind)
    assert f"error[{code_with_slug(code)}]" in validate(file)


def test_standard_input_without_an_end_is_answered() -> None:
    said = validate(Path("-"), stdin=MINIMAL.encode() + b"# x\n" * 10_000_000)
    assert "<stdin>:1:1: error[R2B002 document-too-large]" in said


@pytest.mark.parametrize("form", ["json", "github", "sarif", "junit"])
def test_every_form_holds_hostile_names_and_texts(form: str, tmp_path: Path) -> None:
    file = tmp_path / "a,b:c%\x1b[31m é.r2b.yaml"
    file.write_text(MINIMAL + "labels: {\"\\x07\\u202e\": [1], ']]>': {a: 1}}\n", encoding="utf-8")
    said = validate(file, "--format", form)
    assert "R2B103" in said
    assert "\x1b" not in said


@pytest.mark.parametrize("kibibytes", [128, 512])
@pytest.mark.parametrize("document", ['{"a":' * 100_000, "a: " + "[" * 5_000], ids=["json", "yaml"])
def test_a_small_stack_is_named_and_one_of_half_a_mebibyte_suffices(
    document: str, kibibytes: int, tmp_path: Path
) -> None:
    (tmp_path / "x").write_text(document)
    for verb in ("import", "validate", "plan"):
        ended = subprocess.run(
            [sys.executable, "-P", "-m", "r2bspec", verb, "x"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            preexec_fn=lambda: resource.setrlimit(
                resource.RLIMIT_STACK, (kibibytes << 10, kibibytes << 10)
            ),
        )
        assert ended.returncode in (1, 2), (verb, ended)
        assert ("ulimit -s 8192" in ended.stderr) == (kibibytes < 512)


@pytest.mark.parametrize("exponent", sampled([-999, -300, -31, -30, -12, 15, 16, 300, 999], 4))
@pytest.mark.parametrize("key", ["rates: [@ Hz]", "duration: @ s", "gate: {confidence: @ %}"])
def test_a_quantity_of_any_size_is_a_finding(key: str, exponent: int, tmp_path: Path) -> None:
    quantity = key.replace("@", f"1e{exponent}")
    keys = {"rates": "rates: [30 Hz]"} | {quantity.partition(":")[0]: quantity}
    spec = MINIMAL.replace(
        "benchmark: {rates: [30 Hz]}", f"benchmark: {{{', '.join(keys.values())}}}"
    )
    (tmp_path / "x.r2b.yaml").write_text(spec)
    for verb in ("validate", "plan"):
        r2bspec(verb, "x.r2b.yaml", cwd=tmp_path)
