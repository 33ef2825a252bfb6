"""The dot-test: whether two functions are a linear map and its adjoint.

Forward and adjoint recursions are written separately, and an error in one of them often shows only as a slightly
wrong estimate. The dot-test finds it: <A u, v> = <u, Aᵀ v> must hold for random vectors u and v up to round-off.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError

Array = NDArray[np.float64]

Map = Callable[[Array], Array]


def dot_test(
    forward: Map,
    adjoint: Map,
    n: int,
    m: int,
    generator: np.random.Generator | int = 0,
    *,
    tolerance: float = 1e-10,
) -> float:
    """Relative mismatch of a linear map A and its adjoint: |<A u, v> - <u, Aᵀ v>| / (|A u| |v|).

    Parameters
    ----------
    forward : A, from (n,) to (m,)
    adjoint : Aᵀ, from (m,) to (n,)
    n, m : dimensions of the domain and of the range
    generator : random generator of u and v, or its seed
    tolerance : maximum mismatch, dimensionless

    Raises
    ------
    ModelError
        Where the mismatch exceeds the tolerance, a result has the wrong shape, or ``forward`` maps u to 0.

    Examples
    --------
    >>> A = np.array([[1.0, 2.0, 0.0], [0.0, -1.0, 3.0]])
    >>> dot_test(lambda u: A @ u, lambda v: A.T @ v, 3, 2) < 1e-15
    True
    """
    random = np.random.default_rng(generator)
    u, v = random.standard_normal(n), random.standard_normal(m)
    Au, Atv = forward(u.copy()), adjoint(v.copy())
    for name, result, size in (("forward", Au, m), ("adjoint", Atv, n)):
        if np.shape(result) != (size,):
            raise ModelError(
                f"dot-test: {name} must return the shape ({size},), got {np.shape(result)}"
            )
    scale = float(np.linalg.norm(Au) * np.linalg.norm(v))
    if not scale > 0:
        raise ModelError("dot-test: forward maps a random vector to 0, so that nothing is tested")
    mismatch = float(abs(Au @ v - u @ Atv)) / scale
    if not mismatch <= tolerance:
        raise ModelError(
            f"dot-test: <A u, v> = {Au @ v:.6g} and <u, A' v> = {u @ Atv:.6g} differ by {mismatch:.2g} of |A u| |v|, "
            f"more than {tolerance:g}: the adjoint is not that of the forward map"
        )
    return mismatch
