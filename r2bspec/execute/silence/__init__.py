"""When a message does not arrive: the way is walked, and the first break is named."""
