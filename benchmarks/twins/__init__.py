"""The ambiguous twins of the published bench, identified by `rigctl learn` alone."""
