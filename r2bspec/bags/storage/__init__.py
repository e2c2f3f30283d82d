"""Storage formats of bags: one module for each, behind `r2bspec.bags.storage.storage`."""
