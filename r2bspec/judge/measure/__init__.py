"""From raw samples to metrics, with the formula of each in its docstring."""
