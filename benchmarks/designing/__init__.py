"""The cost of designing the next records."""
