"""Fit, compare and diagnose: their time on the standard campaign, how it grows, and their memory."""
