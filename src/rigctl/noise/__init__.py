"""Noise of the measurements, estimated from arrays of readings without a model of the bench."""

from rigctl.noise.edges import find_edges
from rigctl.noise.estimate import estimate_noise, spikes_of, usual_spacing
from rigctl.noise.noise_model import ChannelNoise, NoiseModel, Source
from rigctl.noise.record import NoiseRecord
from rigctl.noise.residual_noise import ModelResiduals, Width, width_off_model
from rigctl.noise.rows import RowNoise, row_noise, same_reading
from rigctl.noise.scatter import Scatter, estimate_scatter
from rigctl.noise.spikes import find_spikes, find_spikes_in_records
from rigctl.noise.statements import channel_statement, model_statement, recounted
from rigctl.noise.variance import VarianceLaw
from rigctl.noise.whitening import Whitener, whiten

__all__ = [
    "ChannelNoise",
    "ModelResiduals",
    "NoiseModel",
    "NoiseRecord",
    "RowNoise",
    "Scatter",
    "Source",
    "VarianceLaw",
    "Whitener",
    "Width",
    "channel_statement",
    "estimate_noise",
    "estimate_scatter",
    "find_edges",
    "find_spikes",
    "find_spikes_in_records",
    "model_statement",
    "recounted",
    "row_noise",
    "same_reading",
    "spikes_of",
    "usual_spacing",
    "whiten",
    "width_off_model",
]
