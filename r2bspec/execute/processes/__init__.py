"""Child processes of a run: their environment, start, supervision, logs and shutdown."""
