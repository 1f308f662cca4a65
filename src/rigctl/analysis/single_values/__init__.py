"""What tables without time are told besides the verdict: rows, what they exclude, what to measure next."""
