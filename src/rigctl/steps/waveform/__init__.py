"""`waveform`: command one actuator along a ramp, a sine, a multisine, steps or a table."""

from rigctl.steps.waveform.step import Waveform, WaveformStep

__all__ = ["Waveform", "WaveformStep"]
