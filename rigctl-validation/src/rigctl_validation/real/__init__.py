"""The tier of real logs: benches that other people built and measured, from the log to an improved model."""
