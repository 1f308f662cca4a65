"""Fit, compare and diagnose: their time on the standard campaign, its scaling, and their memory."""
