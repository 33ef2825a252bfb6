"""Distance along the line with its uncertainty, from GNSS, odometry and kilometre posts."""
