"""The files and packages of which a graph consists, determined without executing them."""
