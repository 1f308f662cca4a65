"""`rigctl check`."""
