"""Speed, as ratios side by side in one run; one command each, results kept with machine and versions."""
