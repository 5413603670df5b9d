"""What the paper prints in Tables 1 and 2: settling time [s] and RMSE [m, m, rad]; to compare with, not to fit to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

CHANNELS = ("x", "y", "psi")


class Printed(NamedTuple):
    """One controller's figures, each for x, y, psi; an infinite settling time is printed "Unsettled"."""

    settling_time: tuple[float, float, float]
    rmse: tuple[float, float, float]


NEVER = (np.inf, np.inf, np.inf)
TABLE1 = {
    "proposed": Printed((0.14, 0.14, 0.14), (0.2029, 0.2015, 0.1586)),
    "weights_5": Printed((0.15, 0.15, 0.15), (0.2113, 0.2097, 0.1656)),
    "weights_50": Printed((0.22, 0.22, 0.22), (0.3961, 0.4850, 0.3730)),
}
TABLE2 = {
    "proposed": TABLE1["proposed"],
    "osfc": Printed((2.25, 2.25, 2.25), (0.3502, 0.3266, 0.2287)),
    "asmc": Printed((3.76, 3.76, 3.76), (0.3277, 0.3088, 0.2171)),
    "ftsmc": Printed(NEVER, (0.7877, 0.4130, 0.5912)),  # the paper's table calls it TOSMC (reading R16)
    "dfc": Printed(NEVER, (0.5479, 0.3836, 0.5351)),
}
