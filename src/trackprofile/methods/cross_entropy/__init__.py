"""Cross-entropy optimisation of the profile, window by window (paper, section 3)."""
