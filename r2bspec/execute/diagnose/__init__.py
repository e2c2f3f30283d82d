"""Why a graph does not do what the spec says: the facts, the first fault on a path, the error."""
