"""Reading what comes from outside: files, YAML and JSON, with limits, and git.

A spec, a recording or a run folder may be damaged or no regular file; none of that ends in a stack
trace, or in a read without end. Each limit has a constant.
"""
