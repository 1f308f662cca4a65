"""How long a command takes to begin."""
