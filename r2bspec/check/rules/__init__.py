"""The rules, one per file. `r2bspec.check.rule_registry` finds them; nothing else lists them."""
