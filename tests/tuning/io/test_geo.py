"""Tracks in latitude and longitude, against arcs of the ellipsoid that are known by hand."""

import json

import numpy as np
import pytest

from tuning.io import geo

pytest.importorskip("pyproj")
A, F = 6378137.0, 1 / 298.257223563  # WGS 84
E2 = F * (2 - F)


def radii(lat):
    """Of curvature [m] along the meridian, and of the circle of latitude."""
    w = 1 - E2 * np.sin(lat) ** 2
    return A * (1 - E2) / w**1.5, A * np.cos(lat) / np.sqrt(w)


@pytest.mark.parametrize("lat", [0.0, 48.2, -33.9])
def test_a_short_way_north_or_east_has_the_length_of_its_arc(lat):
    step = 1e-3  # deg, about 100 m
    x, y, words = geo.plane("t", np.array([lat, lat + step, lat]), np.array([11.5, 11.5, 11.5 + step]))
    along, round_ = radii(np.radians(lat))
    np.testing.assert_allclose([x[0], y[0], x[1]], 0, atol=1e-6)
    np.testing.assert_allclose(y[1], np.radians(step) * along, rtol=1e-5)
    np.testing.assert_allclose(x[2], np.radians(step) * round_, rtol=1e-5)
    assert f"latitude {lat:.9g}, longitude 11.5" in words


def line(*, crs=None, rows=((11.0, 48.0), (11.001, 48.0), (11.002, 48.001)), kind="LineString"):
    shape = {"type": kind, "coordinates": [list(row) for row in rows]}
    whole = {"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": shape}]}
    return whole | ({"crs": {"type": "name", "properties": {"name": crs}}} if crs else {})


def written(tmp_path, name, content):
    file = tmp_path / name
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(file)


@pytest.mark.parametrize("crs", [None, "urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:EPSG::4326"])
def test_a_line_of_geojson_begins_at_zero_and_goes_east(tmp_path, crs):
    columns, words = geo.read(written(tmp_path, "a.geojson", line(crs=crs)))
    _, round_ = radii(np.radians(48.0))
    np.testing.assert_allclose(columns["x"], np.radians([0, 1e-3, 2e-3]) * round_, rtol=1e-4, atol=1e-6)
    assert columns["y"][2] > 100 and "to the east" in words


def test_a_line_in_metres_of_a_projected_map_stays_as_it_is(tmp_path):
    rows = ((500123.4, 5412345.6), (500125.4, 5412345.6))
    columns, words = geo.read(written(tmp_path, "a.geojson", line(crs="urn:ogc:def:crs:EPSG::32632", rows=rows)))
    np.testing.assert_array_equal(np.column_stack([columns["x"], columns["y"]]), rows)
    assert "EPSG::32632" in words


GPX = """<?xml version="1.0"?><gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>
<trkpt lat="48.0" lon="11.0"><time>2024-05-01T10:00:00Z</time></trkpt>
<trkpt lat="48.0" lon="11.001"><time>2024-05-01T10:00:10Z</time></trkpt>
<trkpt lat="48.001" lon="11.002"><time>2024-05-01T10:00:25Z</time></trkpt></trkseg>{}</trk></gpx>"""


def test_a_gpx_track_has_its_times(tmp_path):
    columns, _ = geo.read(written(tmp_path, "a.gpx", GPX.format("")))
    assert columns["t"].tolist() == [0, 10, 25]
    np.testing.assert_allclose(columns["x"][1], np.radians(1e-3) * radii(np.radians(48.0))[1], rtol=1e-5)
    still, words = geo.read(written(tmp_path, "a.gpx", GPX.format("").replace(":10Z", ":00Z")))
    assert "t" not in still and "do not increase" in words


def test_segments_of_a_track_are_joined_and_their_gaps_said(tmp_path):
    more = GPX[GPX.index("<trkseg>") : GPX.index("{}")].replace('lon="11.0', 'lon="11.01').replace("T10:00", "T10:01")
    columns, words = geo.read(written(tmp_path, "a.gpx", GPX.format(more)))
    assert columns["t"].tolist() == [0, 10, 25, 60, 70, 85]
    _, round_ = radii(np.radians(48.0))
    gap = np.hypot(np.radians(8e-3) * round_, 111.2)  # from longitude 11.002, latitude 48.001, to 11.01, 48
    assert f"2 segments joined across gaps of {gap:.3g} m" in words


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.gpx", "<gpx><trk>", "is no GPX file"),
        ("a.gpx", GPX.format("</trk>" + GPX[GPX.index("<trk>") : GPX.index("{}")]), "it has 2 tracks"),
        ("a.gpx", GPX[: GPX.index("<trk>")] + "</gpx>", "a single point, or none"),
        ("a.geojson", "{", "is no GeoJSON file"),
        ("a.json", "[1, 2]", "a single point, or none"),
        ("a.geojson", line(rows=((11.0, 98.0), (11.0, 48.0))), "must be degrees"),
        ("a.geojson", line(rows=((11.0,), (11.0, 48.0))), "two finite coordinates|list of numbers"),
        ("a.geojson", line(crs="urn:ogc:def:crs:EPSG::3"), "knows no coordinates"),
        ("a.geojson", line(crs="urn:ogc:def:crs:EPSG::4258"), "must be degrees of WGS 84 or metres"),
        # 1 / cos(48 deg) = 1.494, of the sphere; of the ellipsoid's east 1.49
        (
            "a.geojson",
            line(crs="urn:ogc:def:crs:EPSG::3857", rows=((1224514.0, 6106854.0), (1224614.0, 6106854.0))),
            "1.49 times too long",
        ),
        ("a.geojson", line(crs="EPSG:25832", rows=((1e9, 5e6), (1e9, 6e6))), "too long|outside the map"),
        ("a.kml", "<kml/>", "KML is not read; convert it to GPX or GeoJSON"),
    ],
)
def test_a_file_that_is_no_single_line_says_what_it_is(tmp_path, name, content, said):
    with pytest.raises(ValueError, match=said):
        geo.read(written(tmp_path, name, content))


def test_a_system_of_coordinates_without_a_name_is_none(tmp_path):
    text = json.dumps(line() | {"crs": {"type": "name", "properties": None}})
    assert "to the east" in geo.read(written(tmp_path, "a.geojson", text))[1]


def test_a_point_without_a_time_is_named(tmp_path):
    lacks = GPX.format("").replace("<time>", "<extensions>", 1).replace("</time>", "</extensions>", 1)
    columns, words = geo.read(written(tmp_path, "a.gpx", lacks))
    assert "t" not in columns and "its times are not read, point 1 has none" in words


def test_without_the_library_it_is_named_with_its_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "gpxpy", None)
    with pytest.raises(ValueError, match=r"gpxpy is not installed: pip install 'agvjax\[tracks\]'"):
        geo.read(written(tmp_path, "a.gpx", GPX.format("")))
