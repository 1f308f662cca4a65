"""The tier of coverage: sensors and guesses wrong by what is stated of them, and whether intervals say so."""
