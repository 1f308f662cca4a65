"""The ambiguous twins of the published bench, learnt by `rigctl learn` alone."""
