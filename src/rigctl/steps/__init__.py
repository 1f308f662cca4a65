"""What a procedure can do: one file per kind of step, with its fields, its forecast and its behaviour."""
