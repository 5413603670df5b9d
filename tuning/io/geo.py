"""Tracks in latitude and longitude, laid into a plane: GPX, GeoJSON, and columns of a CSV file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from . import files

LARGEST_FILE = 100_000_000  # bytes of a track
EXTRA = "pip install 'agvjax[tracks]'"
DEGREES = "EPSG:4326", "CRS84"  # what a GeoJSON file says, if anything, of coordinates in degrees
MOST = (180.0, 90.0)  # longitude and latitude, either way
STRETCHED = 0.01  # by how much a map's metres may be off

Part = Any  # what JSON may hold, or a library
Track = tuple[dict[str, np.ndarray], str]  # columns by our names, in SI units; and what a person should know of them


def is_geo(file: str) -> bool:
    """Whether a file's name says that it is no CSV file."""
    return Path(file).suffix.lower() in (".gpx", ".geojson", ".json", ".kml")


def read(file: str) -> Track:
    """The one line of a file, from where it begins: x to the east and y to the north [m]; of GPX with its times [s].

    Raises:
        ValueError: names the file and what is wrong with it, or says what has to be installed.
    """
    if Path(file).suffix.lower() == ".kml":
        raise ValueError(f"{file}: KML is not read; convert it to GPX or GeoJSON")
    try:
        text = files.text(Path(file), LARGEST_FILE)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ValueError(f"{file} cannot be read: {reason}") from error
    return _gpx(file, text) if Path(file).suffix.lower() == ".gpx" else _geojson(file, text)


def plane(file: str, lat: np.ndarray, lon: np.ndarray) -> tuple[np.ndarray, np.ndarray, str]:
    """East and north [m] of the first point, on the ellipsoid WGS 84; and the words for it.

    Transverse Mercator about the first point: of a track 10 km long, lengths are off by a millionth.

    Raises:
        ValueError: these are no latitudes and longitudes [deg], or pyproj is not installed.
    """
    bad = ~((np.abs(lat) <= MOST[1]) & (np.abs(lon) <= MOST[0]))
    if bad.any():
        at = int(np.argmax(bad))
        raise ValueError(
            f"{file}: point {at + 1}, latitude {lat[at]:.9g} and longitude {lon[at]:.9g}: must be degrees, from -90 to"
            " 90 and from -180 to 180"
        )
    here = {"proj": "tmerc", "lat_0": lat[0], "lon_0": lon[0], "ellps": "WGS84"}
    x, y = _library("pyproj").Proj(here)(lon, lat)
    words = f"x is to the east, y to the north of its first point, latitude {lat[0]:.9g}, longitude {lon[0]:.9g}"
    return np.asarray(x, float), np.asarray(y, float), words


def _library(name: str) -> Part:
    """A library of the extra `tracks`, which few need."""
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ValueError(f"{name} is not installed: {EXTRA}") from error


def _gpx(file: str, text: str) -> Track:
    """A track, its segments joined, a route or waypoints; of several the one that alone has points."""
    library = _library("gpxpy")
    try:
        whole = library.parse(text)
    except Exception as error:  # gpxpy hands on what its parser of XML raises, which may be lxml's
        raise ValueError(f"{file} is no GPX file: {error}") from error
    parts = [[segment.points for segment in track.segments if segment.points] for track in whole.tracks]
    lines = [[point for part in some for point in part] for some in parts]
    lines = lines or [route.points for route in whole.routes] or [whole.waypoints]
    points = _only(file, [line for line in lines if line], "tracks, or routes,")
    lat, lon = (np.array([getattr(point, name) for point in points], float) for name in ("latitude", "longitude"))
    x, y, words = plane(file, lat, lon)
    columns, times = {"x": x, "y": y}, [point.time for point in points]
    ends = np.cumsum([len(part) for some in parts for part in some])[:-1]  # where a next segment begins
    if ends.size:
        gaps = ", ".join(f"{np.hypot(x[k] - x[k - 1], y[k] - y[k - 1]):.3g}" for k in ends)
        words += f"; {len(ends) + 1} segments joined across gaps of {gaps} m"
    if all(times):
        columns["t"] = np.array([(time - times[0]).total_seconds() for time in times])
        if np.any(np.diff(columns["t"]) <= 0):
            del columns["t"]
            words += "; its times are not read, they do not increase"
    elif any(times):
        first = 1 + next(i for i, time in enumerate(times) if not time)
        words += f"; its times are not read, point {first} has none"
    return columns, f"{file}: {words}"


def _geojson(file: str, text: str) -> Track:
    """A line, a ring, or points in their order; in degrees, or in the metres of the map that the file names."""
    try:
        whole = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{file} is no GeoJSON file: {error}") from error
    shapes = [shape for shape in _shapes(whole) if isinstance(shape, Mapping)]
    alone = [shape.get("coordinates") for shape in shapes if shape.get("type") == "Point"]
    lines = [shape.get("coordinates") for shape in shapes if shape.get("type") in ("LineString", "MultiPoint")]
    for shape in shapes:
        if shape.get("type") in ("MultiLineString", "Polygon") and isinstance(shape.get("coordinates"), list):
            lines += shape["coordinates"]
    line = _only(file, lines or ([alone] if alone else []), "lines")
    try:
        rows = np.array([[float(x) for x in point[:2]] for point in line])
    except (TypeError, ValueError, IndexError) as error:
        raise ValueError(f"{file}: a point of a line must be a list of numbers, [longitude, latitude]") from error
    if rows.ndim != 2 or rows.shape[1] != 2 or not np.all(np.isfinite(rows)):
        raise ValueError(f"{file}: a point of a line must have two finite coordinates at least")
    crs = whole.get("crs") if isinstance(whole, Mapping) else None
    properties = crs.get("properties") if isinstance(crs, Mapping) else None
    named = properties.get("name", "") if isinstance(properties, Mapping) else ""
    if named and not str(named).replace("::", ":").endswith(DEGREES):
        _metres(file, str(named), rows[0])
        return {"x": rows[:, 0], "y": rows[:, 1]}, f"{file}: x and y are those of {named}"
    x, y, words = plane(file, rows[:, 1], rows[:, 0])
    return {"x": x, "y": y}, f"{file}: {words}"


def _metres(file: str, named: str, first: np.ndarray) -> None:
    """Refuse a map whose coordinates (2,) are not metres to the east and to the north, or no true ones.

    A map of the whole earth, as web pages show it, is 1.5 times too large in the middle of Europe.
    """
    library = _library("pyproj")
    try:
        crs = library.CRS.from_user_input(named)
    except library.exceptions.CRSError as error:
        raise ValueError(f"{file}: pyproj knows no coordinates {named}") from error
    if not crs.is_projected or any(axis.unit_name not in ("metre", "meter") for axis in crs.axis_info):
        raise ValueError(f"{file}: its coordinates, {named}, must be degrees of WGS 84 or metres of a projected map")
    projected = library.Proj(crs)
    try:
        there = projected.get_factors(*projected(*first, inverse=True))
    except library.exceptions.ProjError as error:
        raise ValueError(f"{file}: point 1, {first[0]:.9g}, {first[1]:.9g}, lies outside the map {named}") from error
    scale = max(there.meridional_scale, there.parallel_scale, key=lambda x: abs(x - 1))
    if not abs(scale - 1) <= STRETCHED:
        rule = "must be true to within 1 %, as those of UTM are, or degrees of WGS 84"
        raise ValueError(f"{file}: metres of {named} {rule}; at point 1 they are {scale:.3g} times too long")


def _shapes(node: Part) -> list[Part]:
    """The geometries of a collection of features, of one, or of a collection of geometries; in their order."""
    if not isinstance(node, Mapping):
        return []
    if node.get("type") == "FeatureCollection":
        features = node.get("features")
        return [shape for part in features for shape in _shapes(part)] if isinstance(features, list) else []
    if node.get("type") == "Feature":
        return _shapes(node.get("geometry"))
    if node.get("type") == "GeometryCollection":
        return list(node.get("geometries") or [])
    return [node]


def _only(file: str, lines: list[Part], what: str) -> Part:
    """The one line of a file."""
    if len(lines) != 1 or not isinstance(lines[0], list) or len(lines[0]) < 2:
        count = f"{len(lines)} {what} with points" if len(lines) > 1 else "a single point, or none"
        raise ValueError(f"{file} must have one line with two points at least; it has {count}")
    return lines[0]
