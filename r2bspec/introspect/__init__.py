"""Starting nodes once to record their topics, services and parameters."""
