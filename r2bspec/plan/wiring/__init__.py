"""The publishers and subscriptions of every topic, derived from a spec without running it."""
