"""Fusion of many passes over a line into one profile, with its uncertainty and rate of change (theory, section 14).

`fuse` is the entry point. The steps, each in a module of its own: alignment of the passes (`pass_alignment`), stack on
one grid (`stack`) with half-octave subbands (`spectral_bands`, `stated_spectra`), variance components
(`variance_components`), common errors of vehicles (`vehicle_effects`), rejection of outliers (`rejection`), all three
in `weights`; then generalised least squares (`generalised_least_squares`, `combine`), change detection
(`change_detection`) and the summary (`fusion_summary`).
"""
