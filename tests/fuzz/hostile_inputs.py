"""Parts of hostile inputs, and good bags and a good run to damage."""

from __future__ import annotations

import random
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hostile_calls import INSERT_RUN, change_database, make_history, small_run

from data_bags import text, write_bag

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

SECRET_NAME = "FUZZ_API_TOKEN"
SECRET = "hunter2-9f1c7be4d0-do-not-show"

SPEC = """\
r2bspec: 1
name: hostile
data_loader: {bag: ./bag, topics: {/a: a}}
playback: {inputs: {image: {from: a, format: std_msgs/msg/String}}}
graph:
  nodes:
    n:
      command: [x]
      subscribes: {a: std_msgs/msg/String}
      publishes: {output: std_msgs/msg/String}
monitors: {output: {topic: output, format: std_msgs/msg/String, match: order}}
benchmark: {rates: [30 Hz]}
slos: {fast: {at: 30 Hz, require: [latency.p90 < 50 ms]}}
"""
PLACES = {
    "name": "name: hostile",
    "bag": "bag: ./bag",
    "from": "from: a",
    "command": "command: [x]",
    "rates": "rates: [30 Hz]",
    "at": "at: 30 Hz",
    "match": "match: order",
    "topic": "topic: output",
    "r2bspec": "r2bspec: 1",
    "require": "require: [latency.p90 < 50 ms]",
}
WORDS = ("$(env @)", "'a $(env @) b'", "[$(env @)]", "$(env @)/x", "{a: $(env @)}")
"""References to a secret, as the value of a key."""
VALUES = (
    *(
        "''",
        "~",
        "[]",
        "{}",
        "-0",
        "1e308",
        "1e-308 Hz",
        "0x7fffffffffffffffffff",
        ".inf Hz",
        "NaN",
    ),
    *('"\\0"', '"\\ud800"', '"\\e]0;x\\a"', '"\\u202e"', "'::error::x'", "'##[group]x'", "!!str x"),
    *("*a", "&a x", "$(", "$(var x", "$(var a.b)", "$(eval 1)", "2026-01-01", "1:2:3", "(a+)+$"),
    *("/dev/zero", "/proc/self/environ", "../../../../etc/shadow", "file:///etc/passwd", "~root/x"),
    *("[1, [2, [3, [4]]]]", "{a: {b: {c: d}}}", f"'{'x' * 50_000}'", f"'{'a/' * 3_000}'", "true"),
    *(
        f"'{'é' * 5_000}'",
        f"[{'x, ' * 5_000}x]",
        f"{'9' * 900}",
        f"'{'$(var a)' * 2_000}'",
        "/**/**",
    ),
)
KEYS = (
    *("extends: ./h.r2b.yaml", "extends: [[]]", "extends: '.'", "matrix: {axes: {}}", "? [a]\n: b"),
    *(
        "variables: {a: $(var b), b: $(var a)}",
        "environment: [PATH, 'A=B', '']",
        "'': x",
        "<<: [1]",
    ),
    *("ready: {r: {log: {process: n, pattern: 'a{1000}{1000}'}}}", "setup: {s: {command: []}}"),
    *("ready: {r: {log: {process: n, pattern: '(a|b|ab)*c'}}}", "containers: {c: {}}", "labels: 5"),
    "variables: {a: x}\nmatrix: {axes: {a: [" + ", ".join(map(str, range(90))) + "]}}",
    f"labels: {{{', '.join(f'k{i}: v' for i in range(3_000))}}}",
)
PARAMETERS = (
    *(
        "\t" * 9_000,
        "~",
        "5",
        "[]",
        "---\na: 1\n" * 100,
        "a: &a {<<: *a}",
        "'': {ros__parameters: {'': 1}}",
    ),
    *("/**: {ros__parameters: !!set {a, b}}", "/**: {ros__parameters: {a: !!binary aGVsbG8=}}"),
    *("/**: {ros__parameters: {a: 2026-99-99}}", "/**: {ros__parameters: {a: 1e99999, b: .nan}}"),
    "/" + "**/" * 2_000 + "x: {ros__parameters: {a: 1}}",
    "'" + "*a" * 2_000 + "': {ros__parameters: {a: 1}}",
    "/**: {ros__parameters: {a: " + ":".join(["59"] * 300) + "}}",
    "/**: {ros__parameters: {a: [" + "1, " * 20_000 + "1]}}",
    '/**: {ros__parameters: {"\\e]0;x\\a": "::error::x"}}',
    "publishes: {a: {b: c}}",
    "publishes: {'~/~/a': x}\nqos: {a: {depth: -1}}",
    "parameters: {a: {type: nope, default: {}}}",
)
STATEMENTS = (
    *("UPDATE topics SET name = zeroblob(9)", "UPDATE topics SET type = 5", "DROP TABLE schema"),
    *(
        "UPDATE messages SET timestamp = 'x'",
        "UPDATE messages SET data = 'x'",
        "DROP TABLE messages",
    ),
    *("UPDATE messages SET timestamp = 9223372036854775807", "UPDATE messages SET topic_id = 99"),
    *("UPDATE messages SET timestamp = -9223372036854775808", "DROP INDEX timestamp_idx"),
    *(
        "CREATE VIEW v AS SELECT 1",
        "CREATE INDEX i ON messages(hex(zeroblob(length(data) * 99999)))",
    ),
    *("UPDATE schema SET schema_version = 999", "UPDATE topics SET name = char(27) || ']0;x'"),
    "UPDATE topics SET offered_qos_profiles = hex(zeroblob(3000000))",
    "CREATE TABLE z(a DEFAULT (hex(randomblob(1000000000))))",
    "CREATE TRIGGER t AFTER INSERT ON topics BEGIN SELECT 1; END",
)
METADATA = (
    *(("sqlite3", "../../x"), ("sqlite3", "mcap"), ("bag.db3", "/dev/zero"), ("bag.db3", "''")),
    *(("bag.db3", "../x.db3"), ("bag.db3", '"\\0"'), ("message_count: 5", "message_count: -5")),
    *(
        ("message_count: 5", f"message_count: {'9' * 29}"),
        ("message_count: 5", "message_count: []"),
    ),
    *(
        ("/a", '"\\e]0;x"'),
        ("std_msgs/msg/String", "a/b/c/d/e"),
        ("nanoseconds: ", "nanoseconds: -"),
    ),
    *(("cdr", "''"), ("rosbag2_bagfile_information", "x"), ("/a", "x" * 2_000)),
)
REPLACEMENTS: tuple[Any, ...] = (
    *(None, -1, 2**63 - 1, 2**64, 1e300, -1e300, 1e-320, 0, True, "", [], {}, [[]], "\0"),
    *(
        "\x1b]0;x\x07\n::error::x",
        "x" * 100_000,
        "../../../etc/passwd",
        "9" * 5_000,
        {"a": {"b": 1}},
    ),
)
DOCUMENTS = (
    *("{}", "[]", "NaN", "-Infinity", '"x"', '{"a":' * 20_000, "[" * 20_000, "\ufeff{}", "{}{}"),
    *('{"a": ' + "9" * 50_000 + "}", '{"a": "\\ud800"}', '{"10.0": {"BASIC": {"x": "y"}}}'),
    *('{"config": {"x": "\\u001b[31m"}}', '{"r2bspec_result": 1e400}', '{"r2bspec_plan": 1}'),
)


class Prototypes:
    """Good bags, a good run and a history, which readers are given damaged."""

    def __init__(self, folder: Path) -> None:
        messages = [("/a", number, text("x" * number)) for number in range(5)]
        self.bag = write_bag(folder / "bag", messages)
        self.packed = write_bag(folder / "packed", messages, compression="message")
        self.run = small_run(folder / "run")
        from r2bspec.judge.judge_run import result_of, to_json
        from r2bspec.record.run_folder import open_run

        (self.run / "result.json").write_bytes(to_json(result_of(open_run(self.run))))
        self.history = make_history(folder)
        change_database(self.history, INSERT_RUN, *["x" * 9] * 9)


def secret_spec(place: str, word: str) -> str:
    """A spec that writes what is to be kept secret where no secret belongs.

    Args:
        place: one of `PLACES`.
        word: what is written there; ``@`` is the name of the variable.
    """
    key = PLACES[place].partition(":")[0]
    wrong = SPEC.replace(PLACES[place], f"{key}: {word.replace('@', SECRET_NAME)}", 1)
    return f"environment: [{SECRET_NAME}]\n{wrong}"


def damaged(rng: random.Random, data: bytes, alphabet: bytes = b"\x00\xff\x7f\x80") -> bytes:
    """The data with some bits, pieces and numbers changed."""
    changed = bytearray(data)
    for _ in range(rng.randrange(1, 8)):
        at = rng.randrange(max(len(changed), 1))
        match rng.randrange(4):
            case 0 if changed:
                changed[at % len(changed)] ^= 1 << rng.randrange(8)
            case 1:
                del changed[at : at + rng.randrange(1, 40)]
            case 2:
                changed[at : at + 4] = struct.pack("<I", rng.choice([0, 1, 2**31, 2**32 - 1]))
            case _:
                changed[at:at] = bytes(rng.choices(alphabet, k=rng.randrange(1, 8)))
    return bytes(changed)


def zeros(mebibytes: int, *, stated: bool = True) -> bytes:
    """A frame of zstd that unpacks to zeros, with its size in its header or without."""
    packer = zstd.ZstdCompressor()
    if stated:
        packer.set_pledged_input_size(mebibytes << 20)
    return b"".join([*(packer.compress(bytes(1 << 20)) for _ in range(mebibytes)), packer.flush()])


def paths(value: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The way to each value of a document, the document itself first."""
    yield above
    if isinstance(value, dict | list):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        for key, each in pairs:
            yield from paths(each, (*above, key))
