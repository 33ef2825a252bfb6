"""Linear-Gaussian inference in state-space form: filter, smoother, draws, robust reweighting."""
