"""What is said about bags that others recorded."""

from __future__ import annotations

from pathlib import Path

import pytest
from check_specs import codes, findings, write_bag

from data_bags import STRING
from example_spec import example

SECOND = 1_000_000_000


def recorded(window: str = "{}", **sections: str) -> str:
    """A spec that plays /talk of the bag beside it to a program."""
    return example(
        data_loader=f"""
            bag: ./bag
            window: {window}
            topics: {{/talk: talk_raw}}
        """,
        graph=f"""
            nodes:
              listener:
                command: [sh, ./listen.sh]
                subscribes: {{talk: {STRING}}}
                publishes: {{heard: {STRING}}}
        """,
        **{
            "playback": f"{{inputs: {{talk: {{from: talk_raw, format: {STRING}}}}}}}",
            "monitors": f"{{heard: {{topic: heard, format: {STRING}, match: order}}}}",
            **sections,
        },
    )


@pytest.fixture
def spec_file(tmp_path: Path) -> str:
    """A folder with a bag: /talk at 10 Hz for 10 s, /rare at 0 and 9 s."""
    write_bag(
        tmp_path / "bag",
        {"/talk": range(0, 10 * SECOND + 1, SECOND // 10), "/rare": [0, 9 * SECOND]},
    )
    return str(tmp_path / "spec.r2b.yaml")


def test_a_topic_that_the_bag_does_not_hold(spec_file: str) -> None:
    (found,) = findings(recorded().replace("/talk:", "/tlak:"), file=spec_file)
    assert (found.code, found.help) == ("R2B308", "did you mean '/talk'?")


def test_a_format_that_contradicts_the_bag(spec_file: str) -> None:
    text = recorded(playback="{inputs: {talk: {from: talk_raw, format: std_msgs/msg/Bool}}}")
    (found,) = findings(text, file=spec_file)
    assert found.code == "R2B210"
    assert "/talk in the bag is std_msgs/msg/String" in found.message


@pytest.mark.parametrize(
    ("window", "expected"),
    [
        ("{}", []),
        ("{start: 1 s, end: 2 s}", []),
        ("{start: 11 s}", ["R2B309"]),
        ("{start: 11 s, end: 12 s}", ["R2B309"]),
        ("{start: 9 s, end: 12 s}", ["R2B309"]),
        ("{start: 3 s, end: 2 s}", ["R2B320"]),
        ("{start: 3 s, end: 3 s}", ["R2B320"]),
        ("{start: 10 ms, end: 20 ms}", ["R2B321"]),
        ("{start: 10 ms, end: 110 ms}", []),
    ],
)
def test_windows(window: str, expected: list[str], spec_file: str) -> None:
    assert codes(recorded(window), file=spec_file) == expected
    # A name with or without a slash is the same topic.
    assert codes(recorded(window).replace("{/talk:", "{talk:"), file=spec_file) == expected


def test_rare_messages_are_looked_up(spec_file: str) -> None:
    text = recorded("{start: 1 s, end: 8 s}").replace("/talk:", "/rare:")
    assert codes(text, file=spec_file) == ["R2B321"]
    assert codes(text.replace("end: 8 s", "end: 9.5 s"), file=spec_file) == []


@pytest.mark.parametrize("key", ["publish_tf", "publish_tf_static"])
def test_transforms_that_are_not_recorded_are_said(spec_file: str, key: str) -> None:
    text = recorded("{}").replace("window: {}", f"{key}: true")
    missing = [found for found in findings(text, file=spec_file) if found.code == "R2B308"]
    assert [str(found.severity) for found in missing] == ["warning"]


@pytest.mark.parametrize(
    ("damage", "code"),
    [
        ("remove", "R2B301"),
        ("metadata", "R2B302"),
        ("storage", "R2B303"),
        ("garbage", "R2B304"),
        ("pointer", "R2B305"),
    ],
)
def test_a_bag_that_cannot_be_used_is_one_finding_at_its_name(
    damage: str, code: str, spec_file: str
) -> None:
    bag = Path(spec_file).parent / "bag"
    storage = next(bag.glob("*.mcap"))
    match damage:
        case "remove":
            bag.rename(bag.with_name("gone"))
        case "metadata":
            (bag / "metadata.yaml").write_text("x: [", encoding="utf-8")
        case "storage":
            storage.unlink()
        case "garbage":
            storage.write_bytes(b"\0" * 1000)
        case "pointer":
            storage.write_text(
                "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n",
                encoding="utf-8",
            )
    (found,) = findings(recorded(), file=spec_file)
    assert (found.code, found.path) == (code, ("data_loader", "bag"))
    assert found.help


def test_a_bag_that_is_a_map_is_pointed_into(tmp_path: Path) -> None:
    text = recorded().replace("bag: ./bag", "bag: {path: kitchen}")
    (found,) = findings(text, file=str(tmp_path / "spec.r2b.yaml"))
    assert (found.code, found.path) == ("R2B301", ("data_loader", "bag", "path"))
