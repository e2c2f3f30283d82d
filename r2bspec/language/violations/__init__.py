"""Violations of the schema, explained as diagnostics."""

from r2bspec.language.violations.explain_violations import explain_violations

__all__ = ["explain_violations"]
