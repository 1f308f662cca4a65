"""The tier of moving twins: benches that never rest, with noise of every colour, stated or not."""
