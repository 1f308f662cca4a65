"""rigctl beside published figures, on data of other people: real benches and certified regressions."""
