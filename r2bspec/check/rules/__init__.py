"""The rules, in modules by subject; `r2bspec.check.engine` finds every rule in these modules."""
