"""Vehicle parameters, with their uncertainty, from recordings with or without a reference profile."""
