"""What is reported for tables without time besides the verdict: rows, exclusions, what to measure next."""
