"""Noise of the measurements, learned without a model: arrays in, arrays out."""

from rigctl.noise.noise_model import ChannelNoise, NoiseModel, Source
from rigctl.noise.record import NoiseRecord
from rigctl.noise.whitening import Whitener, whiten

__all__ = ["ChannelNoise", "NoiseModel", "NoiseRecord", "Source", "Whitener", "whiten"]
