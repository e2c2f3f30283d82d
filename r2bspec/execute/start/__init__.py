"""One start of all processes: from bring-up through the segments that it plays to its end."""
