"""Preprocessing of a logger's signals: clock, resampling, faults, mounting and motion."""
