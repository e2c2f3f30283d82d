"""The methods by which a requirement is decided, one module each: a question in, an answer out."""
