"""What headings and cells of a table mean: names, units, numbers, times, missing values."""
