"""The engine compared with its alternatives."""
