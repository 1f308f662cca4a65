"""How a model, its versions and its changes are worded."""
