"""Files without an end, links to secrets and names that no file can have, given to every verb."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hostile_calls import ENDLESS, LIVE, LONGEST_S, answered, make_special, small_run

SECRET = "hunter2-do-not-show"
COMMAND = "command: [x]"
DEEP = b'{"a":' * 100_000

pytestmark = pytest.mark.timeout(4 * LONGEST_S)


def validate(folder: Path, node: str = COMMAND) -> str:
    """Return what validate prints of a spec with this node; it never shows the secret."""
    spec = folder / "hostile.r2b.yaml"
    if not os.path.lexists(spec):
        spec.write_text(LIVE.replace("PLACE", node), encoding="utf-8")
    said = answered("validate", spec, cwd=folder, status=(0, 1))
    assert SECRET not in said
    return said


@pytest.mark.parametrize("kind", ENDLESS)
def test_a_file_without_an_end_is_refused(kind: str, tmp_path: Path) -> None:
    make_special(tmp_path / "endless", kind)
    (tmp_path / "interfaces").mkdir()
    (tmp_path / "interfaces/n.yaml").symlink_to("../endless")
    said = validate(tmp_path, f"{COMMAND}, parameters: [./endless, /dev/urandom]")
    assert "parameter file 'endless' cannot be read" in said or "./endless" in said


@pytest.mark.parametrize("kind", ENDLESS)
def test_a_spec_without_an_end_is_refused(kind: str, tmp_path: Path) -> None:
    make_special(tmp_path / "endless", kind)
    (tmp_path / "hostile.r2b.yaml").symlink_to("endless")
    assert "error[R2B001 file-unreadable]" in validate(tmp_path)


def test_no_line_of_a_linked_file_is_shown(tmp_path: Path) -> None:
    folder = tmp_path / "repository"
    (folder / "interfaces").mkdir(parents=True)
    (tmp_path / "credentials").write_text(f"oauth_token: {SECRET}\n{SECRET}: 1\n")
    for name in ("interfaces/n.yaml", "parameters.yaml", "linked.r2b.yaml"):
        (folder / name).symlink_to(tmp_path / "credentials")
    said = validate(folder, f"{COMMAND}, parameters: [./parameters.yaml, ../credentials]")
    assert said.count("it is a link out of its folder") == 2
    why = "cannot read the file: it is a link out of its folder"
    said = answered("validate", "linked.r2b.yaml", cwd=folder, status=1, says=why)
    assert SECRET not in said
    assert "work tree of git" in said


def test_a_link_inside_of_the_folder_or_of_the_work_tree_is_followed(tmp_path: Path) -> None:
    folder, shared = tmp_path / "specs", tmp_path / "shared"
    folder.mkdir()
    shared.mkdir()
    for file in (folder / "real.yaml", shared / "far.yaml"):
        file.write_text(LIVE.replace("PLACE", COMMAND), encoding="utf-8")
    (folder / "near.r2b.yaml").symlink_to("real.yaml")
    (folder / "far.r2b.yaml").symlink_to("../shared/far.yaml")
    for name, is_work_tree, refused in (
        ("near.r2b.yaml", False, False),
        ("far.r2b.yaml", False, True),
        ("far.r2b.yaml", True, False),
    ):
        if is_work_tree:
            (tmp_path / ".git").mkdir()
        said = answered("validate", name, cwd=folder, status=(0, 1))
        assert ("R2B001" in said) == refused


@pytest.mark.parametrize("text", [f"{SECRET}\n", f"a\n  {SECRET}\n"])
def test_a_document_that_is_no_spec_is_described_and_not_quoted(text: str, tmp_path: Path) -> None:
    (tmp_path / "hostile.r2b.yaml").write_text(text, encoding="utf-8")
    assert "the document must be a map, not a" in validate(tmp_path)


@pytest.mark.parametrize("kind", ["pipe", "zeros", "itself", "terabyte"])
@pytest.mark.parametrize("name", ["record.json", "plan.json", "spec.yaml", "resources.npy"])
def test_a_file_of_a_run_without_an_end_is_refused(name: str, kind: str, tmp_path: Path) -> None:
    folder = small_run(tmp_path / "run")
    (file,) = folder.rglob(name)
    file.unlink()
    make_special(file, kind)
    verb = ["report", "--report", "html=a.html"] if name == "spec.yaml" else ["judge"]
    answered(verb[0], folder, *verb[1:], cwd=tmp_path, says="R2B650")


@pytest.mark.parametrize("kind", ["pipe", "zeros", "terabyte", "deep"])
@pytest.mark.parametrize("words", ["compare @ @", "report @", "judge @", "plan @", "data info @"])
def test_a_hostile_file_is_refused_by_every_verb(words: str, kind: str, tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    file.write_bytes(DEEP) if kind == "deep" else make_special(file, kind)
    answered(*words.replace("@", file.name).split(), cwd=tmp_path, status=(2, 4))


LONG = "x" * 300


@pytest.mark.parametrize(
    "words",
    [
        *("judge @", "report @", "compare @ @", "import @", "data info ./@", "data verify @"),
        *("validate @", "plan @", "run @.json --output o", "plan none.json -o @"),
    ],
)
def test_a_name_that_no_file_can_have_is_answered(words: str, tmp_path: Path) -> None:
    said = answered(*words.replace("@", LONG).split(), cwd=tmp_path, status=(1, 2))
    assert "error" in said.lower()


FORGED = "a\nerror[R2B999]: forged\n::error::x \x1b[31m\u202e"
"""Line breaks, a command of a workflow, a colour and a mark that turns a text around."""


def forged_calls(folder: Path) -> Iterator[tuple[str, ...]]:
    """Yield calls that name files of forged names, none of which is valid input."""
    for suffix, content in {".r2b.yaml": "r2bspec: 1\n", ".json": "{", ".db3": "x"}.items():
        (folder / f"{FORGED}{suffix}").write_text(content)
    names = [f"{FORGED}{suffix}" for suffix in (".r2b.yaml", ".json", ".db3", " none")]
    for verb in ("validate", "plan", "run", "judge", "report", "import"):
        yield from ((verb, name) for name in names)
    yield from (("validate", "--format", kind, names[0]) for kind in ("github", "gitlab", "junit"))
    yield ("data", "info", names[2])
    yield ("plan", names[0], "-o", f"{names[3]}/x")
    yield from ((verb, names[3]) for verb in ("docs", "doctor"))
    yield (names[3],)


def test_no_name_makes_a_line_of_its_own(tmp_path: Path) -> None:
    """Whatever a file is called, no line of the output is written by its author."""
    for words in forged_calls(tmp_path):
        said = answered(*words, cwd=tmp_path, status=(0, 1, 2, 3, 4))
        assert not re.findall(r"(?m)^(?:error\[R2B999\]|::error::x).*", said), (words, said)
        assert "\u202e" not in said, (words, said)
