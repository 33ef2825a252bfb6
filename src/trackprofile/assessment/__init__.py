"""From profiles to decisions: exceedances with their probability, classes, changes, repeatability.

`assess` judges one profile by limits; `changes` compares two or more of one place. Both give frozen
results that hold tables: sequences of small dataclasses, in SI units.
"""
