"""What a wheel stands on: a rigid path, or a spring and damper that stand for the track below it."""

from __future__ import annotations

from dataclasses import dataclass

from trackprofile.errors import ModelError


@dataclass(frozen=True)
class RigidTrack:
    """The wheel follows the profile exactly."""


@dataclass(frozen=True)
class ElasticTrack:
    """Each wheel stands on k_t + c_t d/dt, fitted to the track's receptance at low frequency.

    Parameters
    ----------
    stiffness : k_t per wheel, N/m
    damping : c_t per wheel, N s/m

    Examples
    --------
    >>> ElasticTrack(stiffness=87.8e6, damping=36e3).stiffness
    87800000.0
    """

    stiffness: float
    damping: float
    source: str = ""

    def __post_init__(self) -> None:
        if not self.stiffness > 0 or self.damping < 0:
            raise ModelError(
                f"a track needs stiffness above 0 and damping of at least 0, got {self.stiffness} N/m "
                f"and {self.damping} N s/m"
            )


Track = RigidTrack | ElasticTrack
