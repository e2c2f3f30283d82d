"""The rules, by what an author asks; `r2bspec.check.engine` finds every one in these modules."""
