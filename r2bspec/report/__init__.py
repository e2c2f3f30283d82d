"""One module for each form of output; `r2bspec.report.result` holds what they all show."""
