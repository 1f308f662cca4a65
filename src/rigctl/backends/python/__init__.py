"""A driver class of an installed Python package, in a process of its own."""
