"""The law of an effect that the data support, and the effect file offered for it."""
