"""The rendered world behind the synthetic datasets: rooms, motion, sensors."""
