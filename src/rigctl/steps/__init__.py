"""The steps of a procedure: one module per kind, with its fields, its forecast and its behaviour."""
