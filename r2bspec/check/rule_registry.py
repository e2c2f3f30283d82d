"""All rules: every module of `r2bspec.check.rules` defines one, called RULE."""

from __future__ import annotations

import pkgutil
from functools import cache
from importlib import import_module

from r2bspec.check import rules
from r2bspec.check.rule import Rule


@cache
def all_rules() -> tuple[Rule, ...]:
    """Every rule: early rules first, then by code, so that causes come before consequences."""
    modules = pkgutil.iter_modules(rules.__path__, f"{rules.__name__}.")
    found: list[Rule] = [import_module(module.name).RULE for module in modules]
    return tuple(sorted(found, key=lambda rule: (not rule.early, rule.code)))
