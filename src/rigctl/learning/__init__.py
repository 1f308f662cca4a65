"""Measure, compare, add what is sure, design the next records, and measure again."""
