"""Assessment of profiles: exceedance of limits with probabilities, quality classes, change with time, repeatability.

`assess` compares one profile with the limits of its line; `trend` compares several profiles of the same track;
`compare` compares a profile with a reference. The results are frozen dataclasses in SI units.
"""
