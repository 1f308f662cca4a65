"""The hidden-effect benchmark: a separate bench whose secrets are known, and what the tool says about it."""
