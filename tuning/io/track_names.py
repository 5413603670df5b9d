"""What columns of a file of waypoints are called: by others than us, with their units in their names or behind them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from .csv_file import KINDS, UNITS, Column

PLACES = "x y, pos_x pos_y, position_x position_y, x_pos y_pos, x_position y_position, x_axis y_axis, px py"
PLACES += ", pose_position_x pose_position_y, pose_pose_position_x pose_pose_position_y"  # of ROS
PLACES += ", easting northing, utm_easting utm_northing, utm_x utm_y, east north"
WIDTHS = "left right, w_tr_left w_tr_right, width_left width_right, w_left w_right, half_width_left half_width_right"
SPEEDS = "speed velocity v vel vx v_ref vel_ref speed_ref ref_speed target_speed target_velocity"
SPEEDS += " longitudinal_velocity linear_velocity"
PAIRS = {  # by our names that go together, what others call both
    ("x", "y"): PLACES,
    ("lat", "lon"): "lat lon, latitude longitude, lat lng, lat long",
    ("left", "right"): WIDTHS,
}
ALONE = {"speed": SPEEDS, "t": "t time timestamp stamp"}
ACROSS = "vy"  # beside it vx is no speed, but a part of a velocity
STAMP = "%time"  # of a file that `rostopic echo -p` wrote, whose other names begin with field
SUFFIXES = {  # what stands behind a name, for our word for the unit
    **{word: word for word in UNITS},
    **{"mps": "m/s", "m/sec": "m/s", "mmps": "mm/s", "kmh": "km/h", "kmph": "km/h", "kph": "km/h", "sec": "s"},
    **{"meter": "m", "meters": "m", "metre": "m", "metres": "m", "degree": "deg", "degrees": "deg", "nsec": "ns"},
}


def guessed(header: Sequence[str]) -> dict[str, Column]:
    """By our name the column of a header that is called so, or as others call it: `x_m`, `Velocity [km/h]`."""
    parted = [_parted(cell) for cell in header]
    stems = [stem for stem, _ in parted]

    def place(name: str, stem: str) -> Column | None:
        units = KINDS[name].split()
        for cell, (found, unit) in zip(header, parted, strict=True):
            unit = "m/s" if unit == "ms" and name == "speed" else unit
            if found == stem and (not unit or unit in units):
                return Column(cell, "" if UNITS.get(unit) == 1.0 else unit)
        return None

    where: dict[str, Column] = {}
    for names, pairs in PAIRS.items():
        for pair in (words.split() for words in pairs.split(", ")):
            both = [place(name, stem) for name, stem in zip(names, pair, strict=True)]
            if all(both):
                where |= {name: column for name, column in zip(names, both, strict=True) if column}
                break
    for name, words in ALONE.items():
        found = [place(name, word) for word in words.split() if word != "vx" or ACROSS not in stems]
        where |= next(({name: column} for column in found if column), {})
    return where


def _parted(cell: str) -> tuple[str, str]:
    """A name and its unit, both in small letters; no unit where nothing that is one stands behind it."""
    text = cell.strip().strip('"').lower()
    if text == STAMP:
        return "time", "ns"
    text = re.sub(r"[\s./-]*[\s./-](?![^\[(]*[\])])", "_", text).removeprefix("field_")
    if behind := re.fullmatch(r"(.+?)_*[\[(]\s*([^\])]*?)\s*[\])]", text):
        return behind[1], SUFFIXES.get(behind[2], behind[2])
    stem, _, unit = text.rpartition("_")
    return (stem, SUFFIXES[unit]) if stem and unit in SUFFIXES else (text, "")
