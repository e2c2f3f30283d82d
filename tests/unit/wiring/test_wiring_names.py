"""Names are resolved, and keys of parameter files matched, as in ROS."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.plan.wiring.name_resolution import Remapper, ResolvedName, expand, join_namespaces
from r2bspec.plan.wiring.parameter_files import ParameterFile, node_key_matches

# Names are resolved as rcl resolves them.


def remap(name: str, rules: dict[str, str], node: str, namespace: str) -> ResolvedName:
    return Remapper(rules, node, namespace).resolve(name)


TOKEN = st.sampled_from(["a", "b", "ab", "a_", "_b", "a1", "image"])
NAME = st.lists(TOKEN, min_size=1, max_size=3).map("/".join)
NAMESPACE = st.lists(TOKEN, max_size=2).map(lambda tokens: "/" + "/".join(tokens))
TOPIC = st.one_of(NAME, NAME.map("/{}".format), NAME.map("~/{}".format), st.just("~"))


@pytest.mark.parametrize(
    ("outer", "inner", "full"),
    [
        ("/", "r2b", "/r2b"),
        ("/", "/r2b", "/r2b"),
        ("/", "", "/"),
        ("/", "/", "/"),
        ("/r2b", "", "/r2b"),
        ("/r2b", "left", "/r2b/left"),
        ("/r2b", "left/front", "/r2b/left/front"),
        ("/r2b", "/left", "/left"),
        ("/r2b", "/", "/"),
    ],
)
def test_a_namespace_lies_in_another_unless_it_is_absolute(
    outer: str, inner: str, full: str
) -> None:
    assert join_namespaces(outer, inner) == full


@pytest.mark.parametrize(
    ("name", "namespace", "full"),
    [
        ("image", "/r2b", "/r2b/image"),
        ("image", "/", "/image"),
        ("camera/image", "/r2b", "/r2b/camera/image"),
        ("/image", "/r2b", "/image"),
        ("~/image", "/r2b", "/r2b/detector/image"),
        ("~/image", "/", "/detector/image"),
        ("~", "/r2b", "/r2b/detector"),
    ],
)
def test_relative_absolute_and_private_names(name: str, namespace: str, full: str) -> None:
    assert expand(name, "detector", namespace) == full


@pytest.mark.parametrize(
    ("name", "rules", "topic", "rule"),
    [
        ("image", {"image": "camera/image"}, "/r2b/camera/image", "image"),
        ("image", {"/r2b/image": "/image"}, "/image", "/r2b/image"),
        ("/r2b/image", {"image": "x"}, "/r2b/x", "image"),
        ("~/image", {"detector/image": "x"}, "/r2b/x", "detector/image"),
        ("image", {"image": "~/x"}, "/r2b/detector/x", "image"),
        ("image", {"camera/image": "x"}, "/r2b/image", None),
        ("image", {"imag": "x"}, "/r2b/image", None),
        # The first rule that matches; its result is not remapped again.
        ("image", {"/r2b/image": "1", "image": "2"}, "/r2b/1", "/r2b/image"),
        ("a", {"a": "b", "b": "a"}, "/r2b/b", "a"),
    ],
)
def test_a_rule_is_matched_after_expansion(
    name: str, rules: dict[str, str], topic: str, rule: str | None
) -> None:
    assert remap(name, rules, "detector", "/r2b") == ResolvedName(topic, rule)


# Promise: keys of parameter files match as in ROS, in time that no key can drive up.


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
