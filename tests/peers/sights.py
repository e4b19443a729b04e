"""Range, altitude and phase angle of a satellite by skyfield, the Sun by astropy: sights.py TLE NUMBER LATITUDE LONGITUDE HEIGHT TIME..."""
import json
import sys

import numpy as np
from astropy.coordinates import get_body
from astropy.time import Time
from skyfield.api import EarthSatellite, load, wgs84

lines = open(sys.argv[1]).read().splitlines()
number = sys.argv[2]
latitude, longitude, height = map(float, sys.argv[3:6])
scale = load.timescale(builtin=True)
first, second = next(
    (a, b) for a, b in zip(lines, lines[1:]) if a.startswith("1 ") and a[2:7].strip() == number and b.startswith("2 ")
)
satellite = EarthSatellite(first, second, None, scale)
site = wgs84.latlon(latitude, longitude, height)
found = []
for text in sys.argv[6:]:
    time = Time(text.rstrip("Z"), scale="utc")
    at = scale.from_astropy(time)
    topocentric = (satellite - site).at(at)
    altitude, azimuth, distance = topocentric.altaz()
    sun = get_body("sun", time).gcrs.cartesian.xyz.to_value("km")
    place = satellite.at(at).position.km
    to_sun, to_site = sun - place, -topocentric.position.km
    cosine = to_sun @ to_site / np.linalg.norm(to_sun) / np.linalg.norm(to_site)
    found.append([distance.km, altitude.degrees, azimuth.degrees, float(np.degrees(np.arccos(cosine)))])
print(json.dumps(found))
