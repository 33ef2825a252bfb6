"""The full model: any vehicle over any track and irregularity, as a simulation in time."""
