"""The tier of small benches: ten benches with a user's own files, from a CSV file to a verdict."""
