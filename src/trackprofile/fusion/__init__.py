"""Many passes over a line, in one profile with its uncertainty and its rate of change (theory, section 14)."""
