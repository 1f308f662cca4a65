"""The hidden-effect benchmark: a separate bench with known hidden effects, and the tool's answers about
it."""
