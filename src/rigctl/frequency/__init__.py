"""The frequency domain: an excitation of a chosen band, and the frequency response that records show."""
