"""How the results of the commands are printed in the terminal."""
