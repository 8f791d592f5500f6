"""Rows of 3-vectors to hold peers to: of all sizes, structured, and such that products cancel."""

import numpy as np

_POOL = np.array(
    [
        *np.eye(3),
        *-np.eye(3),
        (0.0, 0.0, 0.0),
        (1.0, 1.0, 1.0),
        (1.0, -2.0, 3.0),
        (0.1, 0.2, 0.3),
        (2.0**40, -(2.0**-40), 3.0),
        (np.pi, 0.0, -np.e),
    ]
)


def inputs(*widths, rows=200):
    """An array (3 rows, width) for each width, a multiple of 3.

    First random ones of sizes from 2^-20 to 2^20, then axes, zeros and the like in random combination, then such that
    all 3-vectors of a row are multiples of each other, so that all cross products vanish but for rounding.
    """
    rng = np.random.default_rng(sum(widths))
    vectors = sum(widths) // 3
    spread = rng.normal(size=(rows, vectors, 3)) * np.exp2(rng.integers(-20, 21, (rows, vectors, 3)))
    structured = _POOL[rng.integers(len(_POOL), size=(rows, vectors))]
    parallel = rng.normal(size=(rows, 1, 3)) * rng.normal(size=(rows, vectors, 1))
    table = np.concatenate([spread, structured, parallel]).reshape(3 * rows, 3 * vectors)
    return np.split(table, np.cumsum(widths)[:-1], axis=-1)
