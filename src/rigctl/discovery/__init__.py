"""Beyond any library: where a model lacks a term, its curve over its variables, and formulas for it."""
