"""Rules that find errors in a spec before anything runs."""

from r2bspec.check.engine import check, check_cases

__all__ = ["check", "check_cases"]
