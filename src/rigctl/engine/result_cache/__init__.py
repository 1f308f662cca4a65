"""Results of long computations, kept between commands and identified by their inputs.

A result's name is a hash of everything on which it depends: numbers, equations, options, the code that
computes it and the libraries below that. Nothing needs to be invalidated: a result with other inputs has
another name. A result is the same to the last bit, kept or not: see `cached`.
"""

from rigctl.engine.result_cache.cached import TALLY, cached, switched_off
from rigctl.engine.result_cache.content import Opaque, digest
from rigctl.engine.result_cache.store import RESULTS_VARIABLE, Store, results_folder

__all__ = [
    "RESULTS_VARIABLE",
    "TALLY",
    "Opaque",
    "Store",
    "cached",
    "digest",
    "results_folder",
    "switched_off",
]
