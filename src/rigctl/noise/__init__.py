"""Noise of the measurements, estimated from arrays of readings without a model of the bench."""

from rigctl.noise.edges import find_edges
from rigctl.noise.estimate import estimate_noise, spikes_of
from rigctl.noise.floor import even_pieces, floor_of_residuals, plateau, white_floor
from rigctl.noise.noise_model import ChannelNoise, NoiseModel, Source, Standing
from rigctl.noise.record import NoiseRecord
from rigctl.noise.residual_noise import ModelResiduals, width_off_model
from rigctl.noise.rows import RowNoise, row_noise, same_reading
from rigctl.noise.serial_correlation import autocovariance, correlation_time, portmanteau
from rigctl.noise.spikes import find_spikes, find_spikes_in_records
from rigctl.noise.statements import channel_statement, model_statement, recounted
from rigctl.noise.variance import VarianceLaw
from rigctl.noise.whitening import whiten

__all__ = [
    "ChannelNoise",
    "ModelResiduals",
    "NoiseModel",
    "NoiseRecord",
    "RowNoise",
    "Source",
    "Standing",
    "VarianceLaw",
    "autocovariance",
    "channel_statement",
    "correlation_time",
    "estimate_noise",
    "even_pieces",
    "find_edges",
    "find_spikes",
    "find_spikes_in_records",
    "floor_of_residuals",
    "model_statement",
    "plateau",
    "portmanteau",
    "recounted",
    "row_noise",
    "same_reading",
    "spikes_of",
    "white_floor",
    "whiten",
    "width_off_model",
]
