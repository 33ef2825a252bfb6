"""From recordings to profiles: the smoother, its limit, and the calibration of vehicles."""
