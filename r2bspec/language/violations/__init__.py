"""Violations of the schema, put into words."""

from r2bspec.language.violations.explain_violations import explain_violations

__all__ = ["explain_violations"]
