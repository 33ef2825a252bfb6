"""Railway track profiles, with their uncertainty, from the sensors of an in-service train.

    recording = trackprofile.read("run.toml")
    profile = trackprofile.infer(recording, vehicle)
    trackprofile.write(profile, "profile.nc")

A recording and a profile are ``xarray.Dataset`` objects (see `trackprofile.contracts`); the functions
of this package take and return them.
"""

import lazy_loader

__version__ = "0.1.0"

# A name loads on first use, so that `trackprofile --help` answers at once; the stub lists the names.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
