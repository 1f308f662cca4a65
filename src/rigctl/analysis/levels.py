"""The levels, cut-offs and margins that a verdict is reached with, each with its meaning.

A number that decides stands here; what only says how something is computed (tolerances of a fit, sizes of a
grid) stands where it is computed. Quantiles follow from `ALPHA`; sentences are formatted from these numbers.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Final

#: the chance of calling a right model wrong, and of calling one of two effects the right one by mistake
ALPHA: Final = 0.01
#: standard normal quantile that chance exceeds with probability `ALPHA`
QUANTILE: Final = round(NormalDist().inv_cdf(1.0 - ALPHA), 2)

# --- does the model agree?
#: an error of less than this share of the noise is below it, whatever the fitted unknowns took up
BELOW_NOISE: Final = 0.9
#: sigmas at which an effect stands out of a library of 12 at `ALPHA` in four cases of five, of 50 in seven
#: of ten: below it is no wonder that it was not seen
SEEN_IN_LIBRARY: Final = 4.5
#: what the tests may leave unseen, in χ²: `SEEN_IN_LIBRARY` sigmas of the best score
UNSEEN: Final = 20.0

# --- which effect is it?
#: least separation d at which the right one of two effects wins with probability 1 − `ALPHA`
LEAST_SEPARATION: Final = QUANTILE
#: odds at which one of two sets of effects is preferred, and the difference of mBIC that stands for them
ODDS: Final = round(1.0 / ALPHA)
LEAST_DIFFERENCE: Final = round(2.0 * math.log(ODDS), 1)
#: no model has a bench's exact shape: two effects that differ by less than this share of an effect's size are
#: alike, however small the noise is
TOLERANCE: Final = 0.1
#: standard deviations within which a parameter is not told from the value at which its effect is another one
AT_LIMIT: Final = 2.0
#: twice the standard deviation of a separation that is read from refits
REFIT_SCATTER: Final = 1.0
#: rivals whose signatures are more alike than this are refitted, and worth a word
ALIKE: Final = 0.5
#: but not those that the signatures separate by more than this: no refit brings them back
FAR: Final = 3.0 * LEAST_SEPARATION
#: nor, of a large effect, by more than this share of its size: slopes say no more than that of it
FAR_SHARE: Final = 0.2

# --- in which shape?
#: standard deviation by which the law of a library effect may be bent over what drives it
SHAPE_TOLERANCE: Final = 0.1
#: a rival that leaves more than this share of what an effect explains is not bent to it
BENDS: Final = 0.5
#: nor is one the right effect in another shape that leaves more than this share, its law bent
STAND_IN: Final = 0.18

# --- is it all?
#: the share of a squared misfit that an effect of the right cause may leave with its law bent as far as
#: `SHAPE_TOLERANCE` goes; of a table, whose few rows could follow any bend, with its law as it is
SHAPE: Final = 0.05
SHAPE_OF_ROWS: Final = 0.03
#: a member of a pair that explains less than this share of what both explain may be the shape of the other
SLIGHT: Final = 0.15
#: nor is one named of which the bent laws of the others explain more than this share
BEYOND_SHAPE: Final = 0.5
#: nor, beside effects that the model has already, one of which their bent laws leave less than this share:
#: dry friction beside a leak of three times its size keeps 0.3, the heat capacity of a real board's walls
#: beside three other effects 0.11, what only followed a leak's shape 0.02
BEYOND_LAWS: Final = 0.05
#: but not one beside which less than this share stays of what it explains, with what the tests do not see
WHOLE: Final = 0.1
#: a set of another size must be better by this to be looked at, in χ²
WORTH: Final = 6.0
#: a change of what is left over an operating variable that is no chance, in standard deviations
REMAINDER_TREND: Final = 5.0

# --- does it predict what it was not fitted to?
#: so many standard deviations of all gains together are no chance, each record standing in several folds
FOLDS_GAIN: Final = 3.0
#: a fold that loses by more of its own standard deviations than this was predicted wrongly
FOLD_LOSS: Final = -3.0
#: an effect that is not larger than this in the records that are left, in sigmas, has no size there
FOLD_SEEN: Final = 2.0

# --- has it changed over many runs?
#: the chance that a survey of runs in which nothing changes names a change of any of its quantities
SURVEY_ALPHA: Final = ALPHA
