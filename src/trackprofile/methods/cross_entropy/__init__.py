"""Cross-entropy search of the profile, one window at a time (O'Brien et al. 2017, section 3; theory, section 6)."""
