"""From the recording to the messages that the player publishes, and their times."""
