"""From a logger's raw signals to usable ones: clock, resampling, faults, mounting, motion."""
