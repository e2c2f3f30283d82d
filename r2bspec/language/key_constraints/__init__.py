"""Keys that exclude, require or contradict each other."""
