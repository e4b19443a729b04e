"""Orbits and eclipses by other programs, as the fixtures of fixtures/orbits hold them.

    python ephemeris/tests/peers/orbits.py afspc|places|contacts REPOSITORY > fixtures/orbits/NAME.ecsv

No program here downloads anything.
"""
import importlib.metadata
import os
import sys

import erfa
import numpy as np
from astropy import units as u
from astropy.coordinates import (AltAz, CartesianDifferential, CartesianRepresentation, EarthLocation, GCRS, ITRS, TEME,
                                 get_sun, solar_system_ephemeris)
from astropy.table import Table
from astropy.time import Time, TimeDelta
from astropy.utils import iers
from sgp4.api import Satrec, WGS72

LIGHT_KM_S = 299792.458
# What both sides use: UT1-UTC (s) and the pole (arcsec), near the true values of those days.
EARTH = (0.1952, 0.1040, 0.3730)
EPOCHS = ("2006-06-26T20:10:30", "2006-06-27T05:42:15.25", "2006-06-28T12:00:00")
SITES = {"ufo": (48.78238888888889, 9.196416666666666, 399.0), "paranal": (-24.6272, -70.4048, 2635.0)}
# Of the verification set: low and polar, low and inclined, Molniya, GPS, geostationary.
OBJECTS = (28057, 6251, 21897, 28129, 28626)
SUN_KM, EARTH_KM = 695700.0, 6378.137


class ConstantEarth(iers.IERS):
    """An Earth orientation table that gives the same values at every time."""

    def ut1_utc(self, jd1, jd2=0.0, return_status=False):
        value = np.full(np.shape(jd1), EARTH[0]) * u.s
        return (value, np.zeros(np.shape(jd1), int)) if return_status else value

    def pm_xy(self, jd1, jd2=0.0, return_status=False):
        shape = np.shape(getattr(jd1, "jd1", jd1))
        x, y = (np.full(shape, v) * u.arcsec for v in EARTH[1:])
        return (x, y, np.zeros(shape, int)) if return_status else (x, y)


def versions():
    names = ["sgp4", "astropy", "pyerfa", "skyfield"]
    return ", ".join(f"{n} {importlib.metadata.version(n)}" for n in names)


def verification_set(repository):
    with open(os.path.join(repository, "fixtures/orbits/SGP4-VER.TLE")) as file:
        lines = [line.rstrip() for line in file if not line.startswith("#")]
    return [(one, two[:69], [float(t) for t in two[69:].split()]) for one, two in zip(lines[::2], lines[1::2])]


def elements_of(repository):
    sets = {}
    for one, two, _ in verification_set(repository):
        sets.setdefault(int(one[2:7]), (one, two))
    return {number: sets[number] for number in OBJECTS}


def afspc(repository):
    """The verification set in the published code's mode `a`, and where that fails."""
    rows = []
    for run, (one, two, (start, stop, step)) in enumerate(verification_set(repository)):
        read = Satrec.twoline2rv(one, two, WGS72)
        sat = Satrec()
        sat.sgp4init(WGS72, "a", read.satnum, read.jdsatepoch + read.jdsatepochF - 2433281.5, read.bstar, read.ndot,
                     read.nddot, read.ecco, read.argpo, read.inclo, read.mo, read.no_kozai, read.nodeo)
        minutes = start
        while minutes <= stop:
            error, position, velocity = sat.sgp4_tsince(minutes)
            rows.append((run, read.satnum, minutes, error, *position, *velocity))
            if error:
                break
            minutes += step
    names = "run,norad_id,minutes,error,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s".split(",")
    return Table(rows=rows, names=names), ("The verification set (SGP4-VER.TLE, in its order) in mode `a` of the published "
                                           "code, TEME; each run ends with the first error code")


def teme_km(sat, time):
    error, position, velocity = sat.sgp4(time.utc.jd1, time.utc.jd2)
    assert error == 0
    return np.array(position), np.array(velocity)


def gcrs_km(sat, time):
    """By astropy: TEME, ITRS, GCRS."""
    position, velocity = teme_km(sat, time)
    motion = CartesianDifferential(velocity, unit=u.km / u.s)
    teme = TEME(CartesianRepresentation(position, unit=u.km, differentials=motion), obstime=time)
    found = teme.transform_to(ITRS(obstime=time)).transform_to(GCRS(obstime=time)).cartesian
    return found.xyz.to_value(u.km), found.differentials["s"].d_xyz.to_value(u.km / u.s)


def places(repository):
    iers.earth_orientation_table.set(ConstantEarth())
    from skyfield.api import EarthSatellite, Loader, wgs84
    load = Loader(".", verbose=False)
    ts = load.timescale(delta_t=32.184 + 33.0 - EARTH[0], builtin=True)
    ts.polar_motion_table = (np.array([2.4e6, 2.5e6]), np.full(2, EARTH[1]), np.full(2, EARTH[2]))
    rows = []
    for number, (one, two) in elements_of(repository).items():
        sat = Satrec.twoline2rv(one, two, WGS72)
        sky_sat = EarthSatellite(one, two, "", ts)
        for text in EPOCHS:
            time = Time(text, scale="utc", precision=9)
            t = ts.from_astropy(time)
            for site, (lat, lon, height) in SITES.items():
                def add(peer, kind, az, alt, range_km, position, velocity):
                    rows.append((text + "Z", *EARTH, site, lat, lon, height, number, peer, kind, az, alt, range_km * 1e3,
                                 *position, *velocity))

                # skyfield: its own precession, nutation and sites.
                seen = (sky_sat - wgs84.latlon(lat, lon, elevation_m=height)).at(t)
                alt, az, distance = seen.altaz()
                state = sky_sat.at(t)
                add("skyfield", "geometric", az.degrees, alt.degrees, distance.km, state.position.km,
                    state.velocity.km_per_s)
                # astropy.
                location = EarthLocation.from_geodetic(lon * u.deg, lat * u.deg, height * u.m, ellipsoid="WGS84")
                frame = AltAz(obstime=time, location=location, pressure=0 * u.hPa)
                position, velocity = gcrs_km(sat, time)
                itrs = GCRS(CartesianRepresentation(position, unit=u.km), obstime=time).transform_to(ITRS(obstime=time))
                line = itrs.cartesian - location.get_itrs(time).cartesian
                place = ITRS(line, obstime=time, location=location).transform_to(frame)
                add("astropy", "geometric", place.az.deg, place.alt.deg, line.norm().to_value(u.km), position, velocity)
                # Light time and the aberration of the site's motion by their textbook formulae, on astropy's positions.
                observer, motion = (v.xyz for v in location.get_gcrs_posvel(time))
                observer, motion = observer.to_value(u.km), motion.to_value(u.km / u.s)
                distance = np.linalg.norm(position - observer)
                for _ in range(4):
                    early = time - TimeDelta(distance / LIGHT_KM_S, format="sec")
                    position, velocity = gcrs_km(sat, early)
                    distance = np.linalg.norm(position - observer)
                unit = (position - observer) / distance
                beta = motion / LIGHT_KM_S
                gamma = 1 / np.sqrt(1 - beta @ beta)
                along = unit @ beta
                unit = (unit / gamma + beta * (1 + along / (1 + 1 / gamma))) / (1 + along)
                turned = GCRS(CartesianRepresentation(unit, unit=u.km), obstime=time).transform_to(ITRS(obstime=time))
                place = ITRS(turned.cartesian, obstime=time, location=location).transform_to(frame)
                add("astropy", "apparent", place.az.deg, place.alt.deg, distance, position, velocity)
    names = ("epoch_utc,ut1_minus_utc_s,x_pole_arcsec,y_pole_arcsec,site,latitude_deg,longitude_deg,height_m,norad_id,peer,"
             "kind,azimuth_deg,altitude_deg,range_m,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s").split(",")
    return Table(rows=rows, names=names), ("Satellites of the verification set from two sites: azimuth, altitude without "
                                           "refraction, range, and the GCRS state (geometric: at the epoch; apparent: at emission)")


def with_checksum(line):
    total = sum(int(c) if c.isdigit() else c == "-" for c in line[:68])
    return f"{line[:68]}{total % 10}"


def contacts(repository):
    """Contacts with the shadow of a sphere by the cones that touch Sun and Earth."""
    iers.earth_orientation_table.set(ConstantEarth())
    solar_system_ephemeris.set("builtin")
    rows = []
    runs = [(n, one, two, "2006-06-26T12:00:00", 1.0, "") for n, (one, two) in elements_of(repository).items() if n != 28626]
    one, two = elements_of(repository)[28626]
    runs.append((28626, with_checksum(one[:18] + "06082.50000000" + one[32:]), two, "2006-03-23T00:00:00", 2.0,
                 "epoch moved to the equinox: synthetic"))
    for number, one, two, start, days, note in runs:
        sat = Satrec.twoline2rv(one, two, WGS72)
        start = Time(start, scale="utc", precision=9)

        def clearances(seconds):
            """Distance from the axis minus the radius of the penumbra and of the umbra, km."""
            time = start + TimeDelta(seconds, format="sec")
            error, position, _ = sat.sgp4_array(time.utc.jd1.copy(), time.utc.jd2.copy())
            assert not error.any()
            tt, ut1 = time.tt, time.ut1
            # TEME to the GCRS: sidereal time of 1982 less the Earth rotation angle, then out of the CIO frame.
            angle = erfa.gmst82(ut1.jd1, ut1.jd2) - erfa.era00(ut1.jd1, ut1.jd2)
            x, y, z = position.T
            turned = np.stack([np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x, z], axis=-1)
            position = np.einsum("nji,nj->ni", erfa.c2i06a(tt.jd1, tt.jd2), turned)
            sun = get_sun(time).cartesian.xyz.to_value(u.km).T
            distance = np.linalg.norm(sun, axis=-1)
            axis = sun / distance[:, None]
            behind = -np.einsum("ni,ni->n", position, axis)
            off = np.linalg.norm(position + behind[:, None] * axis, axis=-1)
            wide, narrow = np.arcsin((SUN_KM + EARTH_KM) / distance), np.arcsin((SUN_KM - EARTH_KM) / distance)
            penumbra = off - (EARTH_KM / np.cos(wide) + behind * np.tan(wide))
            umbra = off - (EARTH_KM / np.cos(narrow) - behind * np.tan(narrow))
            return np.where(behind > 0, penumbra, 1e9), np.where(behind > 0, umbra, 1e9)

        grid = np.arange(0.0, days * 86400.0, 10.0)
        for which, name in ((0, "penumbra"), (1, "umbra")):
            values = clearances(grid)[which]
            at = np.nonzero((values[:-1] > 0) != (values[1:] > 0))[0]
            if not len(at):
                continue
            entry = values[at] > 0
            low, high = grid[at], grid[at + 1]
            for _ in range(20):
                middle = (low + high) / 2
                outside = clearances(middle)[which] > 0
                low, high = np.where(outside == entry, middle, low), np.where(outside == entry, high, middle)
            for seconds, entering in zip((low + high) / 2, entry):
                time = (start + TimeDelta(seconds, format="sec")).utc
                rows.append((number, one, two, note, start.isot + "Z", days, name, "entry" if entering else "exit",
                             time.isot + "Z", *EARTH))
    names = "norad_id,line1,line2,note,start_utc,days,shadow,contact,time_utc,ut1_minus_utc_s,x_pole_arcsec,y_pole_arcsec".split(",")
    return Table(rows=rows, names=names), ("Contacts with the shadow of a spherical Earth of 6378.137 km, by the cones that touch "
                                           "the Sun (695700 km) and the Earth, on SGP4's orbit and astropy's apparent Sun")


def main():
    what, repository = sys.argv[1], sys.argv[2]
    iers.conf.auto_download = False
    table, title = {"afspc": afspc, "places": places, "contacts": contacts}[what](repository)
    table.meta["title"] = title
    table.meta["source"] = f"ephemeris/tests/peers/orbits.py {what}, with {versions()}, numpy {np.__version__}"
    table.write(sys.stdout, format="ascii.ecsv", delimiter=",")


main()
