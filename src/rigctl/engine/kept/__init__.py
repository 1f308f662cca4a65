"""Results that took long, kept from one command to the next and found again by what they were computed from.

A result's name is a hash of everything that it depends on: numbers, equations, options, the code that
computes it and the libraries under that. There is nothing to invalidate: what depends on something else has
another name. A result is the same to the last bit, kept or not: see `kept`.
"""

from rigctl.engine.kept.content import Opaque, digest
from rigctl.engine.kept.keep import TALLY, kept, switched_off
from rigctl.engine.kept.store import RESULTS_VARIABLE, Store, results_folder

__all__ = ["RESULTS_VARIABLE", "TALLY", "Opaque", "Store", "digest", "kept", "results_folder", "switched_off"]
