"""Plain data as YAML that the loader of this package reads back unchanged."""

from __future__ import annotations

from typing import Any

import yaml

from r2bspec.language.yaml_scalars import ScalarError, resolve


class _Dumper(yaml.SafeDumper):
    """Writes shared values in full, and quotes what YAML 1.1 or YAML 1.2 would not read as text."""

    def ignore_aliases(self, data: object) -> bool:
        del data
        return True


def _represent_text(dumper: _Dumper, data: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", data, style=_style(data))


def _style(data: str) -> str | None:
    try:
        return None if isinstance(resolve(data), str) else "'"
    except ScalarError:
        return "'"


_Dumper.add_representer(str, _represent_text)


def to_yaml(plain: Any) -> str:
    """The YAML text of dicts, lists and scalars; keys keep their order."""
    written: str = yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)
    return written
