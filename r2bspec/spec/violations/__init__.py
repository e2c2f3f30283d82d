"""Violations of the schema, put into words."""

from r2bspec.spec.violations.explain import explain_violations

__all__ = ["explain_violations"]
