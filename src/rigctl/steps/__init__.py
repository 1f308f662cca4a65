"""The steps of a procedure: one module per kind of step, with its fields, forecast and behaviour."""
