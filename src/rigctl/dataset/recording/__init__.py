"""A run while it is written: journal and log, which survive any ending, and the tables made of them."""
