"""How often `compare` calls a model adequate that is, and one that is not."""
