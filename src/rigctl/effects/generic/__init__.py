"""Effects that may be missing in any bench: offered wherever a slot's dimension and the variables fit.

They are declarations like any other, made for one family at a time: `generic_effects` gives what applies, and
`offers` says for each slot what does, and why nothing does.
"""

from rigctl.effects.generic.offer import Offer, generic_effects, offers

__all__ = ["Offer", "generic_effects", "offers"]
