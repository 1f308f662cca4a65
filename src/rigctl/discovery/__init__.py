"""What no library has: where a model wants a term, its curve over what drives it, and formulas for it."""
