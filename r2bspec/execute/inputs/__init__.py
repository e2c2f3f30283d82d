"""From the recording to what the player publishes, and when."""
