"""What is asked of outputs that have no input, or no partner of the same stamp."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

import pytest
from check_specs import codes, findings

from example_spec import example
from r2bspec.bags import recorded_times
from ros_runs import write_bag

# Messages without a partner of the same stamp are found before a run, where the bag tells.


IMAGE = "sensor_msgs/msg/Image"
LEFT_MS = [33 * number for number in range(60)]


def stereo(
    tmp_path: Path, right_ms: Iterable[int], playback: str = "", window: str = "{}"
) -> tuple[str, str]:
    """A spec that plays both cameras of a bag to one node, and its file."""
    write_bag(tmp_path / "bag", {"/left": LEFT_MS, "/right": [*right_ms]})
    text = example(
        data_loader=f"""
            bag: ./bag
            window: {window}
            topics: {{/left: recorded/left, /right: recorded/right}}
        """,
        playback=f"""
            {playback or "mode: looping"}
            inputs:
              left: {{from: recorded/left, format: {IMAGE}}}
              right: {{from: recorded/right, format: {IMAGE}}}
        """,
        graph=f"""
            nodes:
              matcher:
                command: [sh, ./match.sh]
                subscribes: {{left: {IMAGE}, right: {IMAGE}}}
                publishes: {{output: {IMAGE}}}
        """,
    )
    return text, str(tmp_path / "spec.r2b.yaml")


def shifted(equal: int, total: int) -> list[int]:
    """Stamps of which the first ones are those of the left camera, and the others are near them."""
    return [stamp + (number >= equal) * 3 for number, stamp in enumerate(LEFT_MS[:total])]


def test_cameras_that_are_not_synchronised_are_an_error(tmp_path: Path) -> None:
    text, file = stereo(tmp_path, shifted(3, 56))
    left, right = findings(text, file=file)
    assert (left.code, right.code) == ("R2B415", "R2B415")
    assert (left.severity, right.severity) == ("error", "error")
    assert left.message == "57 of 60 messages of /r2b/left have no partner of the same stamp"
    assert right.message == "53 of 56 messages of /r2b/right have no partner of the same stamp"
    assert "mode: timeline" in right.help
    assert "unpaired: drop" in right.help
    assert "pairing: {slop: ...}" in right.help
    assert codes(text, file=file, offline=True) == []


@pytest.mark.parametrize(
    ("paired", "severities"),
    [(60, []), (57, []), (56, ["warning"] * 2), (30, ["warning"] * 2), (29, ["error"] * 2)],
)
def test_above_5_percent_it_is_a_warning_and_above_50_an_error(
    tmp_path: Path, paired: int, severities: list[str]
) -> None:
    text, file = stereo(tmp_path, shifted(paired, 60))
    assert [each.severity.value for each in findings(text, file=file)] == severities


def test_within_a_slop_only_what_has_no_partner_is_missing(tmp_path: Path) -> None:
    text, file = stereo(tmp_path, shifted(3, 56), "pairing: {slop: 5 ms}")
    (left,) = findings(text, file=file)
    assert left.message == "4 of 60 messages of /r2b/left have no partner within 5 ms"
    text, file = stereo(tmp_path / "narrow", shifted(0, 60), "pairing: {slop: 2 ms}")
    assert [each.severity.value for each in findings(text, file=file)] == ["error"] * 2


def test_a_timeline_plays_everything(tmp_path: Path) -> None:
    text, file = stereo(tmp_path, shifted(3, 56), "mode: timeline")
    assert "R2B415" not in codes(text, file=file)
    text, file = stereo(
        tmp_path / "both", shifted(3, 56), "mode: timeline\n            unpaired: drop"
    )
    assert codes(text, file=file) == ["R2B408"]


def test_stamps_of_large_bags_are_not_read_but_messages_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorded_times, "MAX_STAMPS_BYTES", 0)
    monkeypatch.setattr(recorded_times, "_SAMPLE_BYTES", 0)
    text, file = stereo(tmp_path, shifted(3, 20))
    (left,) = findings(text, file=file)
    assert left.message == (
        "at least 40 of 60 messages of /r2b/left have no partner of the same stamp; "
        "only their numbers were compared, not their stamps"
    )


# Requirements on outputs that come whether inputs do or not.


def test_a_clock_that_is_ahead_is_named_with_its_key(tmp_path: Path) -> None:
    ahead = [stamp + 5_000 for stamp in LEFT_MS]
    text, file = stereo(tmp_path, ahead)
    shutil.rmtree(tmp_path / "bag")
    write_bag(tmp_path / "bag", {"/left": LEFT_MS, "/right": ahead}, recorded_ms=LEFT_MS)
    (right,) = findings(text, file=file)
    assert right.message.endswith("have no partner of the same stamp: its clock was 5 s ahead")
    assert "clock_ahead: 5 s" in right.help
    right_input = f"recorded/right, format: {IMAGE}"
    corrected = text.replace(right_input, f"{right_input}, clock_ahead: 5 s")
    assert findings(corrected, file=file) == []


def test_stamps_that_were_never_set_are_paired_in_order(tmp_path: Path) -> None:
    text, file = stereo(tmp_path, [])
    shutil.rmtree(tmp_path / "bag")
    write_bag(tmp_path / "bag", {"/left": [0] * 60, "/right": [0] * 60})
    assert codes(text, file=file) == ["R2B327"]


def test_a_window_that_is_mostly_a_gap_is_named_with_its_larger_part(tmp_path: Path) -> None:
    times_ms = [*range(5), *range(1_000_000, 1_006_000, 100)]
    text, file = stereo(tmp_path, times_ms)
    shutil.rmtree(tmp_path / "bag")
    write_bag(tmp_path / "bag", {"/left": times_ms, "/right": times_ms})
    (gap,) = findings(text, file=file)
    assert (gap.code, gap.severity) == ("R2B324", "warning")
    assert "a gap of 1000 s, and 120 of its 130 messages after it" in gap.message
    assert "window: {start: 1000 s}" in gap.help
    assert codes(text.replace("window: {}", "window: {start: 1000 s}"), file=file) == []
