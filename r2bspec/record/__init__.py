"""The run folder: the measurements of a run, and writing and reading them."""
