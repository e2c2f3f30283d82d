"""``r2bspec validate`` of many files, and its waivers."""

from __future__ import annotations

from pathlib import Path

import pytest

from command_line import Call
from example_spec import example
from r2bspec.api import InvalidSpecError, prepare
from r2bspec.cli.check_files import CheckOptions, check_files


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    names = []
    for number in range(40):
        file = tmp_path / f"{number}.r2b.yaml"
        rate = "30 Hz" if number % 3 else number
        file.write_text(example(benchmark=f"{{rates: [{rate}]}}"))
        names.append(str(file))
    return names


def test_texts_are_kept_only_where_findings_point_into_them(files: list[str]) -> None:
    checked = list(check_files(files[:2], CheckOptions(offline=True)))
    assert list(checked[0].texts) == [files[0]]
    assert checked[1].texts == {}


def test_a_waiver_holds_for_every_case_of_a_matrix(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    """It is used if one case needs it, though another does not."""
    monkeypatch.chdir(tmp_path)
    document = example(
        variables="{size: 1}",
        matrix="{axes: {size: [1, 20]}}",
        playback="{inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}},"
        " buffer: $(var size)}",
    )
    waiver = "# r2bspec: ignore[R2B323] on purpose"
    Path("a.r2b.yaml").write_text(document)
    assert "R2B323" in call("validate", "a.r2b.yaml").out
    Path("a.r2b.yaml").write_text(document.replace("playback:", f"{waiver}\nplayback:"))
    assert call("validate", "a.r2b.yaml", status=0).out == "1 file, 2 cases, no problems\n"


def test_what_is_waived_can_be_run(tmp_path: Path) -> None:
    file = tmp_path / "a.r2b.yaml"
    document = example(
        playback="{inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}, buffer: 1}"
    )
    file.write_text(document)
    assert [diagnostic.code for diagnostic in prepare(file).diagnostics] == ["R2B323"]
    file.write_text(
        document.replace("buffer: 1}", "buffer: 1} # r2bspec: ignore[R2B323] on purpose")
    )
    assert prepare(file).diagnostics == ()


def test_what_makes_the_document_unusable_stays_an_error(tmp_path: Path) -> None:
    file = tmp_path / "a.r2b.yaml"
    document = example(benchmark="{rates: [30]}").rstrip()
    file.write_text(f"{document} # r2bspec: ignore[R2B109] on purpose\n")
    (checked,) = check_files([str(file)], CheckOptions())
    assert {finding.code for finding in checked.findings} == {"R2B109", "R2B043"}
    with pytest.raises(InvalidSpecError) as caught:
        prepare(file)
    assert {diagnostic.code for diagnostic in caught.value.diagnostics} == {"R2B109", "R2B043"}
