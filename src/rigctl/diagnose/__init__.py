"""From a misfit to the physical effect that is missing, how sure that is, and what it cannot be told from."""
