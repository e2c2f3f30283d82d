"""The rules, one per file. `r2bspec.check.registry` finds them; nothing else lists them."""
