"""The run folder: what a run observed, how it is written and how it is read again."""
