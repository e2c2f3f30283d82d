"""Reports of one file each: one module per format; see `r2bspec.report.format_registry`."""
