"""Rules over a spec: what is wrong with it is told before anything runs."""
