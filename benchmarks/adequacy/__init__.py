"""How often `compare` calls an adequate model, and an inadequate one, adequate."""
