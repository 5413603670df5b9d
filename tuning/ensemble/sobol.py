"""Sobol points of a few sides without `scipy.stats`, whose import takes longer than all else before a search begins.

Joe and Kuo, Constructing Sobol sequences with better two-dimensional projections (SIAM J. Sci. Comput. 30, 2008): their
primitive polynomials and first direction numbers (`new-joe-kuo-6`), which SciPy has too.
"""

from __future__ import annotations

import numpy as np

BITS = 30  # of a point's coordinates, as SciPy's: of more, a float32 would keep no more
FIRST = (  # of each side after the first: the polynomial's bits, and its direction numbers
    (3, (1,)), (7, (1, 3)), (11, (1, 3, 1)), (13, (1, 1, 1)), (19, (1, 1, 3, 3)), (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)), (41, (1, 1, 5, 5, 5)), (47, (1, 1, 7, 11, 19)), (55, (1, 1, 5, 1, 1)),
    (59, (1, 1, 1, 3, 11)), (61, (1, 3, 5, 5, 31)), (67, (1, 3, 3, 9, 7, 49)), (91, (1, 1, 1, 15, 21, 21)),
    (97, (1, 3, 1, 13, 27, 49)), (103, (1, 1, 1, 15, 7, 5)), (109, (1, 3, 1, 15, 13, 25)),
    (115, (1, 1, 5, 5, 19, 61)), (131, (1, 3, 7, 11, 23, 15, 103)), (137, (1, 3, 7, 13, 13, 15, 69)),
    (143, (1, 1, 3, 13, 7, 35, 63)), (145, (1, 3, 5, 9, 1, 25, 53)), (157, (1, 3, 1, 13, 9, 35, 107)),
)  # fmt: skip


def sobol(count: int, size: int, seed: int) -> np.ndarray:
    """Sobol points in the unit cube (count, size), all moved by one random vector, modulo 1."""
    if size > len(FIRST) + 1:
        from scipy.stats import qmc  # late: see above

        points = qmc.Sobol(size, scramble=False).random_base2(int(np.ceil(np.log2(count + 1))))[1 : count + 1]
    else:
        points = _points(count + 1, size)[1:]
    return (points + np.random.default_rng(seed).random(size)) % 1


def _points(count: int, size: int) -> np.ndarray:
    """The first points (count, size), in the order of Gray's code: from one to the next a single bit turns."""
    directions = np.stack([_directions(side) for side in range(size)], axis=1)
    turned = [(k & -k).bit_length() - 1 for k in range(1, count)]
    steps = np.vstack([np.zeros((1, size), np.int64), directions[turned]])
    return np.bitwise_xor.accumulate(steps, axis=0) / 2.0**BITS


def _directions(side: int) -> np.ndarray:
    """The direction numbers (BITS,) of a side, as integers of so many bits."""
    if side == 0:
        return 1 << np.arange(BITS - 1, -1, -1)
    polynomial, first = FIRST[side - 1]
    degree, numbers = len(first), list(first)
    for k in range(degree, BITS):
        number = numbers[k - degree] ^ (numbers[k - degree] << degree)
        for i in range(1, degree):
            number ^= (polynomial >> (degree - i) & 1) * (numbers[k - i] << i)
        numbers.append(number)
    return np.array([m << (BITS - 1 - k) for k, m in enumerate(numbers)])
