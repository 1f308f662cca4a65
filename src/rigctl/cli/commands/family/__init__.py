"""`rigctl family`."""
