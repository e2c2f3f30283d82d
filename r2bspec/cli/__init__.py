"""The command line: modules by subject; `main` has the table of verbs and their places."""
