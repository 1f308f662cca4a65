"""The versions of a model file: kept beside it, never changed."""
