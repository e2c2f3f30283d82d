"""From a `Spec` to a `Plan`: a pure function, and the ways to write a plan down."""
