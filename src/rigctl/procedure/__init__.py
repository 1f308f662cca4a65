"""What to do: the schema of a procedure's steps, and its expansion to a plan."""
