"""`rigctl doctor`."""
