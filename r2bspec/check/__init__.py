"""Rules over a spec: what is wrong with it is told before anything runs."""

from r2bspec.check.engine import check, check_cases

__all__ = ["check", "check_cases"]
