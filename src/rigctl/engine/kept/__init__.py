"""Results of long computations, kept between commands and identified by their inputs.

A result's name is a hash of everything on which it depends: numbers, equations, options, the code that
computes it and the libraries below that. Nothing needs to be invalidated: a result with other inputs has
another name. A result is the same to the last bit, kept or not: see `kept`.
"""

from rigctl.engine.kept.content import Opaque, digest
from rigctl.engine.kept.keep import TALLY, kept, switched_off
from rigctl.engine.kept.store import RESULTS_VARIABLE, Store, results_folder

__all__ = ["RESULTS_VARIABLE", "TALLY", "Opaque", "Store", "digest", "kept", "results_folder", "switched_off"]
