"""Measure, compare, add what is certain, design the next records, and measure again."""
