"""YAML that is not a spec: limits on depth, aliases, merge keys and numbers."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import yaml

from r2bspec.safe_io.safe_yaml import RefusedYamlError, load_texts, load_values


def _nested_merges(levels: int) -> str:
    first = "m0: &m0 {" + ", ".join(f"k{i}: 1" for i in range(10)) + "}\n"
    rest = (
        f"m{i}: &m{i} {{<<: [{', '.join([f'*m{i - 1}'] * 10)}]}}\n" for i in range(1, levels + 1)
    )
    return first + "".join(rest)


def test_values_are_those_of_ros() -> None:
    text = "a: &a {b: yes, n: 0x10, f: 1e3, t: '1', s: 1:59:59}\nc: {<<: *a, d: [1, 2.5, ~]}\n"
    found = load_values(text)
    assert found["a"] == {"b": True, "n": 16, "f": "1e3", "t": "1", "s": 7199}
    assert found["c"] == {**found["a"], "d": [1, 2.5, None]}
    assert load_texts("a: on\nb: 010\n") == {"a": "on", "b": "010"}


@pytest.mark.parametrize("load", [load_values, load_texts])
@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("- " * 40_000 + "a", "line 1: values are nested more than 100 levels deep"),
        ("[" * 40_000, "line 1: values are nested more than 100 levels deep"),
        (_nested_merges(8), "line 5: aliases expand to more than 200,000 values"),
        ("a: &a [1, *a]", "line 1: an alias refers to a value that contains it"),
        ("a:\n" + "- 1\n" * 50_000, "line 49999: there are more than 50,000 values"),
    ],
)
def test_what_exceeds_a_limit_is_refused_with_its_line(
    load: Callable[..., object], text: str, reason: str
) -> None:
    with pytest.raises(RefusedYamlError) as refused:
        load(text, max_values=50_000)
    assert str(refused.value) == reason


def test_merges_below_the_limit_are_loaded() -> None:
    assert len(load_values(_nested_merges(3))["m3"]) == 10


@pytest.mark.parametrize("value", ["9" * 5000, ":".join(["59"] * 2000), "-0x" + "f" * 5000])
def test_a_number_that_takes_long_to_convert_is_refused(value: str) -> None:
    with pytest.raises(RefusedYamlError, match="more than 1,000 characters"):
        load_values(f"a: {value}")
    assert load_values(f"a: '{value}'") == {"a": value}


@pytest.mark.parametrize(
    "text", ["a: 2024-99-99", "{[]: 1}", "a: [", "a: *none", "a: !!python/name:os.system", "\0"]
)
def test_everything_else_is_an_error_of_yaml(text: str) -> None:
    with pytest.raises(yaml.YAMLError):
        load_values(text)
