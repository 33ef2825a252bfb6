"""From a recording to a profile, with the uncertainty of every point and every band."""
