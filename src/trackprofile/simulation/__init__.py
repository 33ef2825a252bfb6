"""Simulation in time of the full coupled model: any vehicle on any track over any irregularity."""
