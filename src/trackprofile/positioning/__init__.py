"""Distance along the line, with its uncertainty, from satellites, odometer and kilometre posts."""
