"""Accuracy of the exponents claimed by a diagnosis."""
