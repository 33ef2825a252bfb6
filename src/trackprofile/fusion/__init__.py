"""Many passes over one line, combined into one profile, with its uncertainty and its rate of change (theory, section 12)."""
