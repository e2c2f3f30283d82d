"""What the machine is fit for: one file per topic, each a function from a `System` to checks."""
