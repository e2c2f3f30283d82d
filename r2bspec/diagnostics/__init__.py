"""Problems as values: where they are, what they are, and the way out."""

from r2bspec.diagnostics.model import Certainty, Diagnostic, Edit, Related, Severity, Span
from r2bspec.diagnostics.suggest import did_you_mean

__all__ = ["Certainty", "Diagnostic", "Edit", "Related", "Severity", "Span", "did_you_mean"]
