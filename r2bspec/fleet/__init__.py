"""Runs on several machines: placed, sent and fetched over Dask distributed."""
