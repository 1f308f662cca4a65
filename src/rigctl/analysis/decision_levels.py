"""The levels, thresholds and margins on which verdicts rest, each with what is compared with what.

Most numbers that decide are defined here, a few beside the one test that uses them; numbers that only set how
something is computed (tolerances of a fit, sizes of a grid) are defined where it is computed. Quantiles
follow from `ALPHA`, and sentences are formatted from these numbers.

χ² is the sum of squares of the whitened residuals. An effect *explains* the increase of χ² without it; "mBIC"
is `rigctl.analysis.linear.mbic.mbic`. "Within the shape tolerance" means with a discrepancy of the law, of
standard deviation `SHAPE_TOLERANCE`, integrated out (`rigctl.analysis.linear.shape_tolerance`).
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Final

#: probability of rejecting a right model, and of preferring the wrong one of two effects
ALPHA: Final = 0.01
#: standard normal quantile that is exceeded by chance with probability `ALPHA`
QUANTILE: Final = round(NormalDist().inv_cdf(1.0 - ALPHA), 2)

# --- does the model agree?
#: ratio of a channel's RMS error to its noise: below it in every channel, the noise was overestimated,
#: whatever the fitted unknowns absorbed
BELOW_NOISE: Final = 0.9
#: share of the squared misfit that an effect must remove to be named where only the white floor of the noise
#: is known
COLLAPSE: Final = 0.3
#: an effect that proves itself leaves more than slow noise if its error is more than this many times the
#: white floor, and its square more than this share of what the model left without it
MANY_FLOORS: Final = 3.0
MOSTLY: Final = 0.1
#: of two effects that both leave more than `MANY_FLOORS`, one is not excluded if its squared error is less
#: than this many times that of the other
CHANGE_PLACES: Final = 2.5
#: an error below this share of a stated noise refutes the statement
REFUTED: Final = 0.5
#: an error of a sensor larger than this many times the white noise of its readings is not the sensor's
SENSOR_SIZE: Final = 1000.0
#: share of the variance of a moving channel (fit, R²) below which no model is adequate, whatever tests say
LEAST_EXPLAINED: Final = 0.5
#: size, in sigmas, at which an effect is detected at `ALPHA` with probability 0.8 in a library of 12 effects
#: and 0.7 in one of 50; a smaller effect may well be present and go undetected
SEEN_IN_LIBRARY: Final = 4.5
#: χ² that an effect may contribute without any test detecting it: the square of `SEEN_IN_LIBRARY`, rounded
UNSEEN: Final = 20.0

# --- which effect is it?
#: half-width of a 95 % interval, in standard deviations; an effect whose sizes all lie this close to none is
#: not determined, whatever it explains
INTERVAL: Final = 1.96
#: smallest separation d of two effects that counts as distinguishable: the right one wins with probability
#: Φ(d), here 1 − `ALPHA`
LEAST_SEPARATION: Final = QUANTILE
#: odds at which one of two sets of effects is preferred to the other, and the difference of mBIC equal to
#: them
ODDS: Final = round(1.0 / ALPHA)
LEAST_DIFFERENCE: Final = round(2.0 * math.log(ODDS), 1)
#: no model has a bench's exact law: two effects whose predictions differ by less than this share of the
#: effect's size (its square, in χ²) are indistinguishable, however small the noise is
TOLERANCE: Final = 0.1
#: a parameter closer than this many standard deviations to a limiting value, at which its effect becomes
#: another effect (or does nothing), is not distinguished from it
AT_LIMIT: Final = 2.0
#: subtracted from a separation d that was computed from refits: twice its standard deviation of 1/2
REFIT_SCATTER: Final = 1.0
#: cosine of two signatures above which they may be confounded: the rival is refitted, and named in the answer
ALIKE: Final = 0.5
#: a rival is not refitted if the signatures separate it by d of more than `FAR` ...
FAR: Final = 3.0 * LEAST_SEPARATION
#: ... and by more than `FAR_SHARE` of the effect's size λ: of a large effect the linearisation is no more
#: accurate than that
FAR_SHARE: Final = 0.2

#: two slots are indistinguishable if their log-evidences differ by less than this (20 to 1), ...
SLOT_SEPARABLE: Final = 3.0
#: ... or by less than this share of the larger, the relative error of a linear model of a large effect
SLOT_LINEAR: Final = 0.01

# --- in which shape?
#: standard deviation of the relative model discrepancy of a library effect's law, over its explanatory
#: variables
SHAPE_TOLERANCE: Final = 0.1
#: a rival that leaves more than this share of what the named effect explains is compared by mBIC alone: no
#: discrepancy of its law could make up for so much
DISCREPANCY_LIMIT: Final = 0.5
#: difference in mBIC, as a share of what the named effect explains, below which a rival may only be standing
#: in for an effect that neither law describes; and the share of the misfit above which a formula does so
STAND_IN: Final = 0.18

# --- is it all?
#: share of the squared misfit that an effect of the right cause may leave: within the shape tolerance of its
#: law; and for a table, whose few rows any discrepancy could follow, with its law exactly as declared
SHAPE: Final = 0.05
SHAPE_OF_ROWS: Final = 0.03
#: a member of a set that explains less than this share of what the whole set explains may be an artefact of
#: the shape of another member's law
SLIGHT: Final = 0.15
#: such a small member is kept only if at least this share of what it explains remains unexplained by the
#: others within their shape tolerance
BEYOND_SHAPE: Final = 0.4
#: an effect beside those that the model already has, and a member of a set whose rest leaves no more than
#: `SHAPE`, is kept only if at least this share of what it explains remains unexplained by the others within
#: their shape tolerance: dry friction beside a leak of three times its
#: size keeps 0.3, the heat capacity of a real board's walls beside three other effects 0.11, an effect that
#: only followed the shape of a leak's law 0.02
BEYOND_LAWS: Final = 0.05
#: a small member is kept only if what the set still leaves, plus `UNSEEN`, is less than this share of what
#: the member explains
WHOLE: Final = 0.1
#: scatter of an effect's size counts as explained by the effect if no more than this share of the sizes have
#: the opposite sign of the mean, ...
REVERSED_SIZES: Final = 0.1
#: ... their root mean square is at most this multiple of the scatter's standard deviation, ...
SIZES_BEYOND_PRIOR: Final = 2.0
#: ... and this many more sizes are known than a plane over the operating variables has coefficients
SPARE_SIZES: Final = 4
#: least reduction of χ², by the linearised model, for which a set with another member or members is refitted
WORTH: Final = 6.0
#: least error of a trend over an operating variable, in standard errors, that is reported: of four trends of
#: a right model one exceeds it with probability `ALPHA`
TREND: Final = 3.0

# --- does it predict what it was not fitted to?
#: the summed gain of all folds must exceed this many of its standard deviations; more than 2, as each record
#: is left out in several folds
FOLDS_GAIN: Final = 3.0
#: a fold whose gain is below this many of its standard deviations was predicted wrongly
FOLD_LOSS: Final = -3.0
#: a fold counts only if the effect's size in the remaining records, in sigmas, exceeds this: otherwise they
#: do not determine it
FOLD_SEEN: Final = 2.0

# --- has it changed over many runs?
#: probability that a survey of runs in which nothing changed reports a change of any of its quantities
SURVEY_ALPHA: Final = ALPHA
