"""Normal equations of unknowns that all measurements share and of a Gauss-Markov chain, solved link by link.

The matrix is block-tridiagonal with a border; elimination from one end costs O(n), so every sight has its own slow
error however many there are. `mount_calibration` calls it.
"""

import numpy as np

from distloc.types import FloatArray


def solve_chain(
    shared: FloatArray,
    shared_g: FloatArray,
    cross: FloatArray,
    own: FloatArray,
    own_g: FloatArray,
    kept: FloatArray,
    state: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The step of m shared unknowns (m,), that of the chain (n, k), and the covariance (m, m) of the shared ones.

    `shared` (m, m), `cross` (n, m, k) and `own` (n, k, k) are the blocks of J'J of the measurements, with the prior of
    the shared ones; `shared_g` (m,) and `own_g` (n, k) are the right-hand sides. The chain's prior is a Gauss-Markov
    process of unit variance in each of its k components, which keeps the share `kept` (n - 1,) of itself from link to
    link and is now at `state` (n, k).
    """
    n, k = state.shape
    precision = 1.0 / (1.0 - kept**2)
    diagonal = np.ones(n)
    diagonal[:-1] += kept**2 * precision  # the first link's own prior is 1 already
    diagonal[1:] += precision - 1.0
    off = -kept * precision
    pull = diagonal[:, None] * state
    pull[:-1] += off[:, None] * state[1:]
    pull[1:] += off[:, None] * state[:-1]
    blocks = own + diagonal[:, None, None] * np.eye(k)
    # right-hand columns: the border's (m), then the residual's
    columns = np.concatenate([np.swapaxes(cross, 1, 2), (own_g - pull)[:, :, None]], axis=2)
    inverses = np.empty_like(blocks)
    inverses[0] = np.linalg.inv(blocks[0])
    for i in range(1, n):
        inverses[i] = np.linalg.inv(blocks[i] - off[i - 1] ** 2 * inverses[i - 1])
        columns[i] -= off[i - 1] * (inverses[i - 1] @ columns[i - 1])
    solved = inverses @ columns
    for i in range(n - 2, -1, -1):
        solved[i] -= off[i] * (inverses[i] @ solved[i + 1])
    by_shared, at_rest = solved[:, :, :-1], solved[:, :, -1]
    covariance = np.linalg.inv(shared - np.einsum("nik,nkj->ij", cross, by_shared))
    step = covariance @ (shared_g - np.einsum("nik,nk->i", cross, at_rest))
    return step, at_rest - by_shared @ step, covariance
