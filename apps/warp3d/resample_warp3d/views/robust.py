"""Robust solution of small overdetermined systems of equations."""

import numpy as np

from resample.types import Doubles

ROUNDS = 20
TIGHT = 1e-3  # in the unknowns' unit: smaller errors count squared, larger ones linearly
HOLD = 1e-6  # weight that holds unknowns without equations at `start`


def solved(rows: Doubles, right: Doubles, sums: Doubles, start: Doubles) -> Doubles:
    """Minimize the sum of absolute errors of `rows @ x = right`.

    Parameters
    ----------
    rows, right
        (N, M) and (N,).
    sums
        (K, M) sums of unknowns that keep their value at `start`.
    start
        (M,) values of unknowns without equations.
    """
    count, held = start.size, len(sums)
    found = start.copy()
    for _ in range(ROUNDS):
        error = np.abs(np.einsum("nm,m->n", rows, found) - right)
        weight = 1.0 / np.maximum(error, TIGHT)
        weight /= weight.sum()
        normal = np.zeros((count + held, count + held))
        weighed = rows * weight[:, None]
        normal[:count, :count] = np.einsum("nm,nk->mk", weighed, rows) + HOLD * np.eye(count)
        normal[:count, count:], normal[count:, :count] = sums.T, sums
        told = np.einsum("nm,n->m", weighed, right) + HOLD * start
        after = np.linalg.solve(normal, np.concatenate([told, sums @ start]))[:count]
        moved = float(np.abs(after - found).max())
        found = after
        if moved < 1e-7:
            break
    return found
