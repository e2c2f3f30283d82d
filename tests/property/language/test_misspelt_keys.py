"""A misspelt key of the language is reported at its line, wherever it stands."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from nightly import sampled
from r2bspec.check import check
from r2bspec.language.declaration import rule_at
from r2bspec.language.load_spec import load_spec

ROOT = Path(__file__).parents[3]
SPECS = sorted((ROOT / "specs").rglob("*.r2b.yaml"))


def keys_of(node: yaml.Node, path: tuple[str | int, ...] = ()) -> Iterator[yaml.ScalarNode]:
    """Yield the keys of the language, and no names that the author of a spec chooses."""
    if isinstance(node, yaml.SequenceNode):
        for number, item in enumerate(node.value):
            yield from keys_of(item, (*path, number))
    elif isinstance(node, yaml.MappingNode):
        rule = rule_at(path)
        for key, value in node.value:
            if rule is not None and key.value in (rule.keys or ()):
                yield key
            yield from keys_of(value, (*path, key.value))


@pytest.mark.parametrize("file", sampled(SPECS, 6), ids=lambda file: file.name.partition(".")[0])
def test_a_misspelt_key_is_reported_at_its_line(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    document = yaml.compose(text)
    assert document is not None
    for key in keys_of(document):
        end = key.end_mark.index
        found = check(load_spec(f"{text[:end]}x{text[end:]}", file=str(file)))
        lines = {finding.span.line for finding in found if finding.severity == "error"}
        assert key.start_mark.line + 1 in lines, f"{file}:{key.start_mark.line + 1}: {key.value}x"
