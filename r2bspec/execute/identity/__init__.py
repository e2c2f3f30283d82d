"""What a graph is made of, looked up without executing anything of it."""
