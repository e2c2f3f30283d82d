"""Reports that are one file each: a module for each format, found by `r2bspec.report.registry`."""
