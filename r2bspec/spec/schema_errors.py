from __future__ import annotations
def explain_schema_errors(tree, sources):
    from r2bspec.spec.validator import schema_errors
    from r2bspec.spec.tree import to_plain, span_at
    from r2bspec.diagnostics import Diagnostic, Severity
    return [Diagnostic("R2B100", Severity.ERROR, e.message, span_at(tree, tuple(e.absolute_path))) for e in schema_errors(to_plain(tree))]
