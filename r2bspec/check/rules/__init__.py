"""The rules, one per file; `r2bspec.check.rule_registry` finds them."""
