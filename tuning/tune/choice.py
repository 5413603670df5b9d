"""Which numbers of a law pay: what each promises to lower the cost by, to first order, beside those tuned already.

Where a law's own gains have been tuned, the linearised problem of `sqp` is solved with them alone and with each further
number besides, and with all of them and without each. The larger of the two differences is what that number promises
within limits and trust region: some pay only together. One that promises next to nothing is left as it is. A slope
alone would say less: k2 is felt 200 times as much as a centre of the heading's network, but all it can do is done.
"""

from __future__ import annotations

import numpy as np

from .methods import sqp
from .methods.method import Progress
from .methods.quadratic import Unsolved
from .tuner import Tuner

PAYS = sqp.LEAST  # share of the cost that a number must promise: as much as a step of the search


def promises(tuner: Tuner, p: Progress, moving: np.ndarray) -> np.ndarray:
    """By which share of the cost (K,) each gain that is not `moving` (K,) would lower it; 0 for those that are.

    Also 0 where the linear problem is not solved: slopes of runs that chatter promise nothing.

    Args:
        tuner: the problem.
        p: the search that found the gains to look at, of a method that keeps a penalty.
        moving: gains that are tuned in any case.
    """
    values, ok, slopes = (np.asarray(x) for x in tuner.push(p.best_z, tuner.scenarios()))
    objective = tuner.objective._replace(penalty=float(p.optimiser.penalty))

    def reached(free: np.ndarray) -> float:
        model = (values, ok, np.where(free[:, None, None], slopes, 0.0))
        return sqp.solve(model, objective, tuner.baseline, sqp.LARGEST).cost

    found = np.zeros(len(moving))
    try:
        alone, together = reached(moving), reached(np.ones_like(moving))
        if alone == 0:
            return found  # nothing is left to gain
        for k in np.flatnonzero(~moving):
            this = np.arange(len(moving)) == k
            found[k] = max(0.0, alone - reached(moving | this), reached(~this) - together) / abs(alone)
    except Unsolved:
        return np.zeros(len(moving))
    return found
