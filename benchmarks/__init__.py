"""Benchmarks: speed as ratios within one run; one command each; results stored with machine and versions."""
