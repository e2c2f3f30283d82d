"""The search for the deployment of a graph that meets its objectives at the least cost."""
