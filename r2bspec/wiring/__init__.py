"""Who writes and who reads which topic, worked out from a spec without running anything."""
