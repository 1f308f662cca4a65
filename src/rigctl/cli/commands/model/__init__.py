"""`rigctl model`."""
