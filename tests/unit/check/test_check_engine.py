"""Rules and their pages are complete, and are run over a spec without saying a thing twice."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from check_specs import codes, findings
from rosbags.interfaces import Nodetype

from command_line import Call
from example_spec import example
from r2bspec.bags import message_types
from r2bspec.check.engine import all_rules
from r2bspec.diagnostics import Severity
from r2bspec.diagnostics.code_pages import all_pages, find_page
from r2bspec.language.load_spec import load_spec
from r2bspec.report.findings_text import code_with_slug

# Rules are run over a spec, and what follows from something already said is left out.


ROOT = Path(__file__).parents[3]


def test_errors_of_the_document_stop_the_rules_and_warnings_do_not() -> None:
    text = example(
        graph="nodes: {relay: {python: r2bspec.nodes.RelayNode, remappings: {input: imgae}}}"
    )
    found = findings(text.replace("name: example", "nam: example"))
    assert {each.code[:4] for each in found} == {"R2B1"}
    assert codes("\ufeff" + text) == ["R2B004", "R2B207"]


@pytest.mark.parametrize(
    ("written", "edit"), [("10", "10.0"), ("0x0a", "10.0"), ("'10'", None), ("$(var time)", None)]
)
def test_an_edit_is_offered_only_for_exactly_what_is_written(
    written: str, edit: str | None
) -> None:
    text = example(
        variables="{time: 10}",
        graph="nodes: {relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image},"
        f" parameters: {{service_time_ms: {written}}}}}}}",
    )
    found = next(each for each in findings(text) if each.code == "R2B212")
    assert (found.edit.text if found.edit else None) == edit
    if found.edit is not None:
        assert found.edit.span == found.span


def test_offline_nothing_is_said_about_data(tmp_path: Path) -> None:
    text = example(data_loader="{bag: ./nowhere, topics: {/camera: image_raw}}")
    file = str(tmp_path / "spec.r2b.yaml")
    assert codes(text, file=file) == ["R2B301"]
    assert codes(text, file=file, offline=True) == []


@pytest.mark.parametrize("file", sorted((ROOT / "specs").rglob("*.r2b.yaml")), ids=lambda f: f.stem)
def test_nothing_is_said_about_the_specs_that_are_shipped(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("R2B_DATASETS", raising=False)
    loaded = load_spec(file)
    from r2bspec.check import check

    # Packages of ROS that no wheel has may be missing here, and so may their messages.
    missing = [each for each in check(loaded) if each.code in {"R2B622", "R2B681"}]
    assert check(loaded) == missing
    assert all(each.certainty == "environment" for each in missing)
    first = loaded.texts[str(file)].splitlines()[0]
    assert first.startswith("# yaml-language-server: $schema=")
    assert (file.parent / first.partition("=")[2]).resolve().is_file()


def test_node_code_beside_the_spec_is_read_but_not_executed(tmp_path: Path) -> None:
    witness = tmp_path / "executed"
    (tmp_path / "nodes.py").write_text(
        f"open({str(witness)!r}, 'w')\nclass Detector: ...\n", encoding="utf-8"
    )
    text = example(
        graph="nodes: {a: {python: './nodes.py:Detector',"
        " subscribes: {image: sensor_msgs/msg/Image},"
        " publishes: {output: sensor_msgs/msg/Image}}}"
    )
    assert codes(text, file=str(tmp_path / "spec.r2b.yaml")) == []
    assert not witness.exists()


# Every rule is complete and well formed; so is every page.


def test_causes_come_before_consequences() -> None:
    found = [rule.code for rule in all_rules()]
    late = [rule.code for rule in all_rules() if not rule.early]
    assert late == sorted(late)
    assert found[len(found) - len(late) :] == late
    assert len(found) == len(set(found)), "every code has one rule"


def test_a_rule_is_named_as_its_page_which_shows_it_in_a_few_lines() -> None:
    for rule in all_rules():
        page = rule.page
        assert re.fullmatch(r"R2B[2-68]\d\d", rule.code)
        assert page.slug == rule.find.__name__.replace("_", "-")
        assert page.title[0].islower() or page.title.startswith("ROS"), rule.code
        assert bool(page.failing) == bool(page.passing), rule.code
        failing, passing = set(page.failing.splitlines()), set(page.passing.splitlines())
        assert len(failing ^ passing) <= 14, rule.code


def test_every_page_says_what_and_why_and_has_a_slug_of_its_own() -> None:
    pages = all_pages()
    assert len({page.slug for page in pages.values()}) == len(pages)
    for code, page in pages.items():
        assert re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", page.slug), code
        assert len(page.slug) <= 40, code
        assert page.title, code
        assert not page.title.endswith("."), code
        assert page.why.endswith((".", ")")), code
        assert isinstance(page.severity, Severity)
        assert find_page(code) == page
    assert find_page("R2B999") is None


# The pieces that rules are made of.


def test_the_frequent_types_are_what_rosbags_says() -> None:
    fields = message_types.typestore().fielddefs
    for name in message_types.WITH_HEADER | message_types.WITHOUT_HEADER:
        begins = fields[name][1][0][1] == (Nodetype.NAME, "std_msgs/msg/Header")
        assert begins is (name in message_types.WITH_HEADER)
    assert message_types.begins_with_header("geometry_msgs/msg/WrenchStamped") is True
    assert message_types.begins_with_header("geometry_msgs/msg/Wrench") is False
    assert message_types.begins_with_header("my_msgs/msg/Thing") is None


# ``r2bspec docs``: what a code means.


@pytest.mark.parametrize(
    ("written", "code"),
    [("r2b204", "R2B204"), ("204", "R2B204"), ("unknown-key", "R2B101"), ("Unknown_Key", "R2B101")],
)
def test_a_code_may_be_written_in_short_and_a_slug_is_as_good(
    written: str, code: str, call: Call
) -> None:
    explained = call("docs", written, status=0).out
    assert explained == call("docs", code, status=0).out
    assert explained.startswith(code_with_slug(code))


def test_all_codes_are_listed(call: Call) -> None:
    said = call("docs", "codes", status=0).out
    for code, page in all_pages().items():
        assert f"  {code}  " in said
        assert f"  {page.slug}  " in said
        assert page.title in said


@pytest.mark.parametrize(
    ("written", "meant"),
    [("unknown-kye", "unknown-key"), ("R2B999", ""), ("R2B658x9", "")],
)
def test_an_unknown_word_is_answered_with_a_close_one(written: str, meant: str, call: Call) -> None:
    said = call("docs", written, status=2).err
    assert f"error[R2B601 wrong-usage]: there is no page, code or metric '{written}'" in said
    assert (f"did you mean {meant}?" in said) if meant else ("did you mean" not in said)
