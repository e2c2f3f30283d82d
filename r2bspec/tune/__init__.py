"""The search for the values of a spec that meet its objectives at the least cost, and its proof."""
