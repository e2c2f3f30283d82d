"""Promise: keys of parameter files match as in ROS, in time that no key can drive up."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.plan.wiring.parameter_files import (
    ParameterEffort,
    ParameterFile,
    node_key_matches,
    read_parameter_file,
)
from r2bspec.safe_io.limits import MAX_VALUES_OF_NODES

PATTERNS = st.lists(st.sampled_from(["a", "ab", "*", "**", "a*", "*b", "a*b", "*a*"]), max_size=5)
NAMES = st.lists(st.sampled_from(["a", "b", "ab", "aab", "aba"]), min_size=1, max_size=5)


def matches(pattern: list[str], name: list[str]) -> bool:
    """What the keys mean, said without regard to time."""
    if not pattern:
        return not name
    if pattern[0] == "**":
        return matches(pattern[1:], name) or (bool(name) and matches(pattern, name[1:]))
    return bool(name) and within(pattern[0], name[0]) and matches(pattern[1:], name[1:])


def within(pattern: str, token: str) -> bool:
    if not pattern:
        return not token
    if pattern[0] == "*":
        return bool(token) and (within(pattern[1:], token[1:]) or within(pattern, token[1:]))
    return bool(token) and pattern[0] == token[0] and within(pattern[1:], token[1:])


@given(PATTERNS, NAMES)
def test_a_key_matches_what_its_tokens_mean(pattern: list[str], name: list[str]) -> None:
    key, full_name = "/" + "/".join(pattern), "/" + "/".join(name)
    assert node_key_matches(key, full_name) == (bool(pattern) and matches(pattern, name))


@pytest.mark.parametrize(
    ("key", "name"),
    [
        ("/**" * 12 + "/zz", "/a" * 30),
        ("/**/a" * 15 + "/zz", "/a" * 300),
        ("/" + "*a" * 30 + "z", "/" + "a" * 300),
    ],
)
def test_a_key_that_could_match_in_very_many_ways_is_answered(key: str, name: str) -> None:
    assert not node_key_matches(key, name)


def test_exact_keys_and_wildcards_apply_in_the_order_of_the_file() -> None:
    file = ParameterFile((("/**", {"a": 1}), ("/n", {"a": 2}), ("/*", {"a": 3}), ("/m", {"a": 4})))
    assert file.matching("/n") == [{"a": 1}, {"a": 2}, {"a": 3}]
    assert file.matching("/m/n") == [{"a": 1}]


def test_too_many_wildcards_and_too_many_values_are_named(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("".join(f"/**/n{i}: {{ros__parameters: {{a: 1}}}}\n" for i in range(101)))
    assert "100 keys with wildcards" in read_parameter_file(path).problem
    file = ParameterFile((("/**", {f"p{i}": i for i in range(1000)}),))
    assert ParameterEffort().limited(file, MAX_VALUES_OF_NODES // 1000) is file
    assert "together" in ParameterEffort().limited(file, MAX_VALUES_OF_NODES // 1000 + 1).problem
