"""Starting the processes of a run, and waiting until all are ready."""
