"""Two or more results beside each other: what improved, what got worse, what cannot be told."""
