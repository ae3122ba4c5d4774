"""Places of the area on the Earth: a plane that touches the ellipsoid of GPS, there and back."""

import math

# WGS84, the ellipsoid of GPS.
_SEMI_MAJOR_AXIS_M = 6378137.0
_FLATTENING = 1 / 298.257223563
_ECCENTRICITY_2 = _FLATTENING * (2 - _FLATTENING)
_N_ROUNDS = 8  # each leaves a small part of the error before, less so near the poles


def east_north_m(
    lat_deg: float, lon_deg: float, *, origin_lat_deg: float, origin_lon_deg: float
) -> tuple[float, float]:
    """East and north of an origin [m], in the plane that touches the ellipsoid there.

    Over d metres the plane shortens distances by d^3 / (6 R^2): 0.1 mm at 3 km, 4 mm at 10 km.
    Heights are taken as zero: 100 m of height changes distances by 16 ppm.

    Source: WGS84 ellipsoid, NIMA TR8350.2.
    """
    lat, lon = math.radians(origin_lat_deg), math.radians(origin_lon_deg)
    point = _earth_centred_m(math.radians(lat_deg), math.radians(lon_deg))
    corner = _earth_centred_m(lat, lon)
    x_m, y_m, z_m = (a - b for a, b in zip(point, corner, strict=True))
    east_m = math.cos(lon) * y_m - math.sin(lon) * x_m
    outward_m = math.cos(lon) * x_m + math.sin(lon) * y_m
    return east_m, math.cos(lat) * z_m - math.sin(lat) * outward_m


def lat_lon_deg(
    east_m: float, north_m: float, *, origin_lat_deg: float, origin_lon_deg: float
) -> tuple[float, float]:
    """Latitude and longitude [deg] of a place in that plane: the inverse of `east_north_m`.

    Exact to a micrometre within 50 km of an origin that is not above 80 degrees north or south.
    Longitudes are from -180 to 180.
    """
    lat_deg, lon_deg = origin_lat_deg, origin_lon_deg
    for _ in range(_N_ROUNDS):
        is_m = east_north_m(
            lat_deg, lon_deg, origin_lat_deg=origin_lat_deg, origin_lon_deg=origin_lon_deg
        )
        lat = math.radians(lat_deg)
        bend = 1 - _ECCENTRICITY_2 * math.sin(lat) ** 2
        across_m = _SEMI_MAJOR_AXIS_M / math.sqrt(bend)  # radius of curvature, east to west
        along_m = across_m * (1 - _ECCENTRICITY_2) / bend  # and south to north
        lat_deg += math.degrees((north_m - is_m[1]) / along_m)
        lon_deg += math.degrees((east_m - is_m[0]) / (across_m * math.cos(lat)))
    return lat_deg, (lon_deg + 180) % 360 - 180


def _earth_centred_m(lat: float, lon: float) -> tuple[float, float, float]:
    radius_m = _SEMI_MAJOR_AXIS_M / math.sqrt(1 - _ECCENTRICITY_2 * math.sin(lat) ** 2)
    return (
        radius_m * math.cos(lat) * math.cos(lon),
        radius_m * math.cos(lat) * math.sin(lon),
        radius_m * (1 - _ECCENTRICITY_2) * math.sin(lat),
    )
