"""Promise: what strangers wrote is read within limits, and no more of it than needed."""

from __future__ import annotations

from pathlib import Path

import pytest

from command_line import Call
from data_bags import text, write_bag, write_mcap, write_ros1
from example_spec import example
from r2bspec import api
from r2bspec.language.environment_access import UntrustedSpecs
from r2bspec.safe_io.decompression_budget import chosen_max_bytes, max_unpacked, max_unpacked_bytes
from r2bspec.safe_io.limits import MAX_PIECE_BYTES

# Promise: `--max-bytes` is the most that each file of a bag unpacks to, in every verb.


# Every frame is 64 KiB of one letter, which packs very well.
MESSAGES = [("/a", number, text("x" * 65_536)) for number in range(10)]
ALL_BYTES = 10 * 65_536

SPEC = """\
r2bspec: 1
name: packed
data_loader: {bag: PLACE, topics: {/a: a}}
playback: {inputs: {image: {from: a, format: std_msgs/msg/String}}}
graph: {nodes: {n: {command: [x], subscribes: {a: std_msgs/msg/String}}}}
monitors: {output: {topic: output, format: std_msgs/msg/String}}
benchmark: {rates: [30 Hz]}
"""


def every_bag(folder: Path) -> list[Path]:
    return [
        write_bag(folder / "messages", MESSAGES, compression="message"),
        write_bag(folder / "files", MESSAGES, compression="file"),
        write_bag(folder / "chunks", MESSAGES, storage="mcap", compression="storage"),
        write_mcap(folder / "lone.mcap", MESSAGES),
        write_ros1(folder / "old.bag", MESSAGES, compression="bz2"),
    ]


def test_a_bag_that_unpacks_to_more_is_refused(tmp_path: Path, call: Call) -> None:
    for bag in every_bag(tmp_path):
        said = call("data", "verify", bag, "--max-bytes", ALL_BYTES // 2, status=1)
        assert "--max-bytes" in said.out + said.err, bag
        call("data", "verify", bag, "--max-bytes", "2 MiB", status=0)
        assert chosen_max_bytes() is None, "the limit ends with the verb"


@pytest.mark.parametrize(
    ("verb", "status"), [("validate", 1), ("plan", 2), ("data info", 2)], ids=str
)
def test_the_index_of_a_bag_is_enough_to_refuse_it(
    verb: str, status: int, tmp_path: Path, call: Call
) -> None:
    bag = write_bag(tmp_path / "bag", MESSAGES, storage="mcap", compression="storage")
    spec = tmp_path / "packed.r2b.yaml"
    spec.write_text(SPEC.replace("PLACE", "./bag"), encoding="utf-8")
    file = bag if verb == "data info" else spec
    said = call(*verb.split(), file, "--max-bytes", "100 kB", status=status)
    assert "the 100,000 bytes of --max-bytes" in said.out + said.err
    said = call(*verb.split(), file, "--max-bytes", "1 MB")
    assert "--max-bytes" not in said.out + said.err
    assert said.status == 0 or verb != "data info"


def test_the_limit_takes_the_place_of_the_ratio() -> None:
    with max_unpacked_bytes(1 << 40):
        assert max_unpacked(1) == MAX_PIECE_BYTES
    with max_unpacked_bytes(1000):
        assert max_unpacked(1 << 30) == 1000


def test_an_index_in_the_cache_does_not_stand_in_for_the_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("r2bspec.check.check_context._MIN_CACHED_BYTES", 1)
    write_bag(tmp_path / "bag", MESSAGES, storage="mcap", compression="storage")
    spec = tmp_path / "packed.r2b.yaml"
    spec.write_text(SPEC.replace("PLACE", "./bag"), encoding="utf-8")
    call("validate", spec)
    entries = list((tmp_path / "cache").rglob("*.json"))
    assert entries
    assert "--max-bytes" in call("validate", spec, "--max-bytes", "100 kB").out
    # No other user may read the names of topics, or put an index of theirs there.
    for entry in entries:
        assert entry.stat().st_mode & 0o077 == 0
        assert entry.parent.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("size", ["0", "-1", "many", "1 s", "9" * 30, "1e999 GiB"])
def test_what_is_no_size_is_refused(size: str, tmp_path: Path, call: Call) -> None:
    assert "max-bytes" in call("data", "info", tmp_path, f"--max-bytes={size}", status=2).err


# Promise: `interfaces` and the functions of `api` read no more of a stranger than the verbs.


@pytest.fixture
def listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A spec that lists a variable."""
    monkeypatch.setenv("NAME_OF_IT", "relay")
    spec = tmp_path / "listed.r2b.yaml"
    spec.write_text(example(environment="[NAME_OF_IT]"), encoding="utf-8")
    return spec


def test_interfaces_refuses_a_variable_before_a_node_starts(listed: Path, call: Call) -> None:
    shown = call("interfaces", "--untrusted", listed, status=2).err
    assert "R2B143" in shown
    assert "starting" not in shown
    assert not (listed.parent / "interfaces").exists()


def test_interfaces_refuses_a_link_out_of_the_folder(
    listed: Path, tmp_path: Path, call: Call
) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    (folder / "linked.r2b.yaml").symlink_to(listed)
    assert "R2B001" in call("interfaces", folder / "linked.r2b.yaml", status=2).err


def test_the_functions_take_what_the_verbs_take(listed: Path, tmp_path: Path) -> None:
    untrusted = UntrustedSpecs()
    assert "R2B143" in {one.code for one in api.validate(listed, untrusted=untrusted)}
    assert "R2B143" not in {one.code for one in api.validate(listed)}
    for function in (api.load, api.compile_plan):
        with pytest.raises(api.InvalidSpecError) as caught:
            function(listed, untrusted=untrusted)
        assert "R2B143" in {diagnostic.code for diagnostic in caught.value.diagnostics}
    folder = tmp_path / "other"
    folder.mkdir()
    linked = folder / "linked.r2b.yaml"
    linked.symlink_to(listed)
    assert "R2B001" in {one.code for one in api.validate(linked)}
    assert "R2B001" not in {one.code for one in api.validate(linked, allow_paths=[tmp_path])}
    with pytest.raises(api.InvalidSpecError):
        api.load(linked)
    assert api.load(linked, allow_paths=[tmp_path]).name == "example"
