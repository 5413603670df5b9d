"""Columns by the names that others give them, with their units."""

import pytest

from tuning.io.csv_file import Column, names, read
from tuning.io.track_names import guessed


@pytest.mark.parametrize(
    ("header", "found"),
    [
        ("x_m,y_m,w_tr_right_m,w_tr_left_m", {"x": "x_m", "y": "y_m", "right": "w_tr_right_m", "left": "w_tr_left_m"}),
        ("s_m,x_m,y_m,psi_rad,kappa_radpm,vx_mps,ax_mps2", {"x": "x_m", "y": "y_m", "speed": "vx_mps"}),
        ("x,y,z,yaw,velocity,change_flag", {"x": "x", "y": "y", "speed": "velocity"}),
        ("X,Y,Z", {"x": "X", "y": "Y"}),
        ("pos_x,pos_y,v", {"x": "pos_x", "y": "pos_y", "speed": "v"}),
        ("pose.pose.position.x,pose.pose.position.y", dict(x="pose.pose.position.x", y="pose.pose.position.y")),
        ("easting,northing", {"x": "easting", "y": "northing"}),
        ("latitude,longitude", {"lat": "latitude", "lon": "longitude"}),
        ("x,y,x_m,y_m", {"x": "x", "y": "y"}),  # our own names first
        ("x,pos_y", {}),  # no pair
        ("x_ref_m,y_ref_m,alpha_m", {}),  # of a reference line, which is another path
        ("x_s,y_s", {}),  # no length
        ("px,py,vx,vy", {"x": "px", "y": "py"}),  # a velocity by its parts is no speed
    ],
)
def test_a_column_is_known_by_what_it_is_called(header, found):
    assert {name: place.column for name, place in guessed(header.split(",")).items()} == found


def test_a_unit_is_read_off_the_name():
    header = ["x [cm]", "y [cm]", "Velocity (km/h)", "time_ms"]
    units = {"x": "cm", "y": "cm", "speed": "km/h", "t": "ms"}
    assert guessed(header) == {n: Column(c, units[n]) for n, c in zip(("x", "y", "speed", "t"), header, strict=True)}
    assert guessed(["speed_mph"]) == {"speed": Column("speed_mph", "mph")}
    assert guessed(["speed_ms"]) == {"speed": Column("speed_ms")}  # no milliseconds
    recorded = guessed(["%time", "field.pose.pose.position.x", "field.pose.pose.position.y"])  # rostopic echo -p
    assert recorded["t"] == Column("%time", "ns") and set(recorded) == {"x", "y", "t"}


@pytest.mark.parametrize(
    ("text", "header", "x"),
    [
        ("# x_m,y_m\n# made by hand\n1,2\n3,4\n", ["x_m", "y_m"], [1, 3]),  # the comment that has two names
        ("# 3b5f\n# 603f\n# s_m; x_m; y_m\n0;1;2\n1;3;4\n", ["s_m", "x_m", "y_m"], [1, 3]),
        ("// x, y, mode\n1, 2, on\n3, 4, off\n", ["x", "y", "mode"], [1, 3]),  # a row with a word is no header
        ("1,2\n3,4\n", ["1", "2"], [1, 3]),
    ],
)
def test_a_header_is_found_where_it_stands(tmp_path, text, header, x):
    file = tmp_path / "track.csv"
    file.write_text(text)
    assert names(file) == header
    column = next(name for name in header if name in ("x", "x_m", "1"))
    assert read(file, [column])[column].tolist() == x
