"""First specs from what a person has: a recording, a launch file, a node, a running system."""
