"""How a set-point schedule and its check are worded."""
