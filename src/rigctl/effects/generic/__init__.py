"""Effects that may be missing in any bench: offered wherever a slot's dimension and the variables fit.

They are declarations like any other, made for one family at a time: `generic_effects` returns the applicable
ones, and `offers` lists for each slot which apply, and why others do not.
"""

from rigctl.effects.generic.offer import generic_effects, offers

__all__ = ["generic_effects", "offers"]
