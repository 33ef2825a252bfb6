"""The physics as data and linear algebra: vehicles, tracks, sensors, spectra, state space."""
