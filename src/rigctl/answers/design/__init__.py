"""How designed records are worded."""
