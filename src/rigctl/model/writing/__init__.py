"""Change a model file and keep its comments and its layout."""
