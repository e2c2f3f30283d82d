"""The host during a run: its description, resource use and interference from other processes."""
