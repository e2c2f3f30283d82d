"""Reading what comes from outside: files, YAML, JSON, SQLite and compressed data, with limits.

Specs, bags, parameter files, run folders and reports may be written to attack the machine that
reads them. Everything of them is opened and decoded here. Each limit has a constant.
"""
