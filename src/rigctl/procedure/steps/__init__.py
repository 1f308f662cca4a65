"""The steps a procedure is written in: one file for each group, each step its own schema and its own node."""
