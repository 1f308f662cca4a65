"""The tier of anyone's benches: ten small benches with a user's own files, from a CSV file to a verdict."""
