"""Places on the sky by other programs, as the fixtures of fixtures/sky hold them.

    python radiometry/tests/peers/sky.py places|frames|orientation|bodies|planets REPOSITORY > fixtures/sky/NAME.ecsv

No program here may download anything: the ephemerides are SOFA's own (astropy's "builtin"), libastro's (ephem), and the
excerpts of JPL's DE430 and JUP310 that skyfield ships with its tests.
"""
import os
import sys

import astropy
import erfa
import numpy as np
from astropy import units as u
from astropy.coordinates import (AltAz, CartesianRepresentation, EarthLocation, GCRS, ITRS, SkyCoord, get_body, get_sun,
                                 solar_system_ephemeris)
from astropy.table import Table
from astropy.time import Time
from astropy.utils import iers

# What both sides use: UT1-UTC (s) and the pole (arcsec), near the true values of those days.
EPOCHS = {
    "2015-03-03T22:30:00": (-0.5180, 0.012, 0.350),
    "2016-12-31T23:59:60.5": (-0.4082, 0.080, 0.263),
    "2026-03-14T04:20:30.25": (0.0600, 0.110, 0.380),
}
SITES = {
    "ufo": (48 + 46 / 60 + 56.6 / 3600, 9 + 11 / 60 + 47.1 / 3600, 399.0),
    "paranal": (-24.6272, -70.4048, 2635.0),
}
# Over declination; alp1 Cen, eps Ind and tau Cet move fast and are near; Deneb has no motion in the table.
STARS = {11767: "Polaris", 91262: "Vega", 97649: "Altair", 69673: "Arcturus", 71683: "Rigil Kentaurus",
         108870: "eps Ind", 32349: "Sirius", 82273: "Atria", 102098: "Deneb", 8102: "tau Cet"}
# A satellite, GCRS, km: geometric line of sight only.
SATELLITE_KM = (4210.0, 1830.0, 5320.0)


class ConstantEarth(iers.IERS):
    """An Earth orientation table that gives the same values at every time."""

    values = (0.0, 0.0, 0.0)

    def ut1_utc(self, jd1, jd2=0.0, return_status=False):
        value = np.full(np.shape(jd1), self.values[0]) * u.s
        return (value, np.zeros(np.shape(jd1), int)) if return_status else value

    def pm_xy(self, jd1, jd2=0.0, return_status=False):
        shape = np.shape(getattr(jd1, "jd1", jd1))
        x, y = (np.full(shape, v) * u.arcsec for v in self.values[1:])
        return (x, y, np.zeros(shape, int)) if return_status else (x, y)


def versions():
    import importlib.metadata as m
    names = ["astropy", "pyerfa", "skyfield", "jplephem", "ephem", "astropy-iers-data"]
    return ", ".join(f"{n} {m.version(n)}" for n in names if _has(n))


def _has(name):
    import importlib.metadata as m
    try:
        m.version(name)
    except m.PackageNotFoundError:
        return False
    return True


def skyfield_data(name):
    import skyfield
    return os.path.join(os.path.dirname(skyfield.__file__), "tests", "data", name)


def catalogue(repository):
    table = Table.read(os.path.join(repository, "radiometry/data/bright_stars.ecsv"), format="ascii.ecsv")
    return {int(row["hip"]): row for row in table if int(row["hip"]) in STARS}


def known(value):
    return not np.ma.is_masked(value) and np.isfinite(float(value))


def astropy_star(row, time):
    ra, dec = row["ra_deg"] * u.deg, row["dec_deg"] * u.deg
    if not known(row["pm_ra_mas_yr"]):
        return SkyCoord(ra, dec)
    star = SkyCoord(ra, dec, pm_ra_cosdec=row["pm_ra_mas_yr"] * u.mas / u.yr, pm_dec=row["pm_dec_mas_yr"] * u.mas / u.yr,
                    distance=(1000.0 / row["parallax_mas"]) * u.pc, radial_velocity=0 * u.km / u.s,
                    obstime=Time("J2000", scale="tdb"))
    return star.apply_space_motion(new_obstime=time)


def places(repository):
    rows = []
    stars = catalogue(repository)
    for text, (dut1, x, y) in EPOCHS.items():
        ConstantEarth.values = (dut1, x, y)
        iers.earth_orientation_table.set(ConstantEarth())
        time = Time(text, scale="utc", precision=9)
        assert abs(time.delta_ut1_utc - dut1) < 1e-12
        independent = text.startswith("2015-03-03")
        solar_system_ephemeris.set(skyfield_data("de430-2015-03-02.bsp") if independent else "builtin")
        ephemeris = "DE430" if independent else "SOFA"
        for site, (lat, lon, height) in SITES.items():
            location = EarthLocation.from_geodetic(lon * u.deg, lat * u.deg, height * u.m, ellipsoid="WGS84")
            frame = AltAz(obstime=time, location=location, pressure=0 * u.hPa)

            def add(body, kind, altaz, distance_m, peer="astropy"):
                rows.append((text + "Z", dut1, x, y, site, lat, lon, height, body, kind, altaz[0], altaz[1], distance_m,
                             peer, ephemeris if kind in ("sun", "moon") else ""))

            for hip, row in stars.items():
                place = astropy_star(row, time).transform_to(frame)
                add(f"HIP {hip}", "star", (place.az.deg, place.alt.deg), np.nan)
            for body in ("sun", "moon"):
                place = get_body(body, time, location).transform_to(frame)
                add(body, body, (place.az.deg, place.alt.deg), place.distance.to_value(u.m))
            satellite = GCRS(CartesianRepresentation(*SATELLITE_KM, unit=u.km), obstime=time).transform_to(
                ITRS(obstime=time))
            line = satellite.cartesian - location.get_itrs(time).cartesian
            place = ITRS(line, obstime=time, location=location).transform_to(frame)
            add("satellite", "satellite", (place.az.deg, place.alt.deg), line.norm().to_value(u.m))
            if independent:
                for body, kind, az, alt, distance in by_skyfield(text, (dut1, x, y), (lat, lon, height), stars):
                    add(body, kind, (az, alt), distance, peer="skyfield")
    names = ("epoch_utc,ut1_minus_utc_s,x_pole_arcsec,y_pole_arcsec,site,latitude_deg,longitude_deg,height_m,body,kind,"
             "azimuth_deg,altitude_deg,distance_m,peer,ephemeris").split(",")
    table = Table(rows=rows, names=names)
    for axis, km in zip("xyz", SATELLITE_KM):
        table[f"{axis}_gcrs_km"] = [km if kind == "satellite" else np.nan for kind in table["kind"]]
    return table, ("Azimuth and altitude without refraction (pressure 0) of ten stars, the Sun, the Moon and a fixed GCRS "
                   "point, with the Earth orientation given in each row")


def by_skyfield(text, earth, site, stars):
    """Skyfield has its own precession, nutation, aberration and deflection: no code of SOFA."""
    from skyfield.api import Loader, Star, wgs84

    dut1, x, y = earth
    load = Loader(skyfield_data(""), verbose=False)
    delta_at = float(erfa.dat(int(text[:4]), int(text[5:7]), int(text[8:10]), 0.0))
    ts = load.timescale(delta_t=32.184 + delta_at - dut1, builtin=True)
    ts.polar_motion_table = (np.array([2.4e6, 2.5e6]), np.array([x, x]), np.array([y, y]))
    t = ts.from_astropy(Time(text, scale="utc"))
    planets = load("de430-2015-03-02.bsp")
    observer = planets["earth"] + wgs84.latlon(site[0], site[1], elevation_m=site[2])
    targets = [(f"HIP {hip}", "star", Star(
        ra_hours=row["ra_deg"] / 15, dec_degrees=row["dec_deg"],
        ra_mas_per_year=row["pm_ra_mas_yr"] if known(row["pm_ra_mas_yr"]) else 0.0,
        dec_mas_per_year=row["pm_dec_mas_yr"] if known(row["pm_dec_mas_yr"]) else 0.0,
        parallax_mas=row["parallax_mas"] if known(row["parallax_mas"]) else 0.0)) for hip, row in stars.items()]
    targets += [("sun", "sun", planets["sun"]), ("moon", "moon", planets["moon"])]
    for body, kind, target in targets:
        alt, az, distance = observer.at(t).observe(target).apparent().altaz()
        yield body, kind, az.degrees, alt.degrees, distance.m if kind != "star" else np.nan


def frames(_repository):
    rows = []
    for text, (dut1, x, y) in EPOCHS.items():
        utc = Time(text, scale="utc")
        tai = erfa.utctai(utc.jd1, utc.jd2)
        tt = erfa.taitt(*tai)
        ut1 = erfa.utcut1(utc.jd1, utc.jd2, dut1)
        matrix = erfa.c2t06a(*tt, *ut1, x * erfa.DAS2R, y * erfa.DAS2R)
        sun = get_sun(utc).cartesian.xyz.value
        rows.append((text + "Z", dut1, x, y, *matrix.flatten(), erfa.era00(*ut1), erfa.eo06a(*tt),
                     *(sun / np.linalg.norm(sun))))
    names = (["epoch_utc", "ut1_minus_utc_s", "x_pole_arcsec", "y_pole_arcsec"]
             + [f"m{i}{j}" for i in range(3) for j in range(3)] + ["era_rad", "equation_of_origins_rad", "sun_x", "sun_y", "sun_z"])
    return Table(rows=rows, names=names), ("GCRS to ITRS by c2t06a, row by row; Earth rotation angle; equation of the origins; the "
                                             "Sun from the Earth's centre by astropy's get_sun")


def orientation(_repository):
    import astropy_iers_data
    path = os.path.join(os.path.dirname(astropy_iers_data.__file__), "data", "eopc04.1962-now")
    data = np.loadtxt(path, comments="#")
    # A row every 41 days falls on every place between the 5-day rows; and all days about the leap seconds and the ends.
    mjd = data[:, 4]
    first, last = 53371, 61312
    keep = (mjd >= first) & (mjd <= last) & ((mjd - first) % 41 == 0)
    for day in (53736, 54832, 56109, 57204, 57754, 54209, last):
        keep |= (abs(mjd - day) <= 3) & (mjd <= last)
    table = Table(data[keep][:, [4, 5, 6, 7]], names=["mjd_utc", "x_pole_arcsec", "y_pole_arcsec", "ut1_minus_utc_s"])
    return table, "Days of IERS EOP 20 C04, most of them between the rows of the embedded 5-day table"


def bodies(_repository):
    """Astrometric directions (light time, no aberration) and distances from the Earth's centre, ICRS axes."""
    rows = []
    for name, excerpt, start, step, count, targets in (
            ("DE430", "de430-2015-03-02.bsp", 2457081.0, 0.3, 26, {"sun": [(0, 10)], "moon": [(0, 3), (3, 301)]}),
            ("JUP310", "jup310-2053-10-08.bsp", 2471181.6, 1.1, 7, {"sun": [(0, 10)]})):
        from jplephem.spk import SPK
        kernel = SPK.open(skyfield_data(excerpt))

        def at(chain, tdb):
            return sum(kernel[pair].compute(tdb) for pair in chain)

        for i in range(count):
            # TDB is 1.7 ms from TT at most: 0.001 arcsec of the Moon.
            tt = start + i * step
            earth = at([(0, 3), (3, 399)], tt)
            for body, chain in targets.items():
                line = at(chain, tt) - earth
                for _ in range(3):
                    line = at(chain, tt - np.linalg.norm(line) / 299792.458 / 86400.0) - earth
                add_line(rows, name, body, tt, line * 1000.0)
    import ephem
    for i in range(40):
        date = ephem.Date(ephem.Date("2005/01/03 05:00:00") + i * 203.37)
        tt = date + 2415020.0 + ephem.delta_t(date) / 86400.0
        for body, target in (("sun", ephem.Sun()), ("moon", ephem.Moon())):
            target.compute(date, epoch=ephem.J2000)
            line = np.array([np.cos(target.a_dec) * np.cos(target.a_ra), np.cos(target.a_dec) * np.sin(target.a_ra),
                             np.sin(target.a_dec)]) * target.earth_distance * 149597870700.0
            add_line(rows, "libastro", body, tt, line)
    table = Table(rows=rows, names="ephemeris,body,jd_tt,ra_deg,dec_deg,distance_m".split(","))
    return table, ("The Sun and the Moon from the Earth's centre by theories that are not SOFA's: astrometric place (light "
                   "time, no aberration), ICRS axes. libastro leaves the Earth's motion out of the Moon's light time. ephem's libastro is good to 1 to 2 arcsec itself")


PLANETS = {"Mercury": ([(0, 1), (1, 199)], 199), "Venus": ([(0, 2), (2, 299)], 299), "Mars": ([(0, 4)], 4),
           "Jupiter": ([(0, 5)], 5), "Saturn": ([(0, 6)], 6)}


def planets(_repository):
    """Mercury to Saturn: astrometric directions from the Earth's centre as in `bodies`, by JPL's and libastro's theories, with the V magnitudes of skyfield's
    magnitudelib (a port of Mallama's and Hilton's own program); and apparent azimuth and altitude by astropy."""
    from jplephem.spk import SPK
    from skyfield import magnitudelib
    import ephem
    rows = []

    def v_mag(name, sun_m, line_m):
        # sun_m: from the Sun to the planet, line_m: from the Earth to the planet.
        r, delta = (np.linalg.norm(v) / 149597870700.0 for v in (sun_m, line_m))
        angle = lambda a, b: np.degrees(np.arccos(np.dot(a, b) / np.linalg.norm(a) / np.linalg.norm(b)))
        function = magnitudelib._FUNCTIONS[PLANETS[name][1]]
        phase = angle(sun_m, line_m)
        if name == "Saturn":
            pole = magnitudelib._SATURN_POLE
            return float(function(r, delta, phase, angle(pole, sun_m) - 90.0, angle(pole, line_m) - 90.0))
        return float(function(r, delta, phase))

    def add(ephemeris, name, tt, line_m, sun_m):
        start = len(rows)
        add_line(rows, ephemeris, name, tt, line_m)
        rows[start] = rows[start] + (v_mag(name, sun_m, line_m), "", np.nan, np.nan)

    for ephemeris, excerpt, start, step, count, wanted in (
            ("DE430", "de430-2015-03-02.bsp", 2457081.0, 0.9, 8, list(PLANETS)), ("JUP310", "jup310-2053-10-08.bsp", 2471181.6, 1.1, 6, ["Jupiter"])):
        kernel = SPK.open(skyfield_data(excerpt))

        def at(chain, tdb):
            return sum(kernel[pair].compute(tdb) for pair in chain)

        for i in range(count):
            tt = start + i * step
            earth = at([(0, 3), (3, 399)], tt)
            for name in wanted:
                chain, then = PLANETS[name][0], tt
                for _ in range(4):
                    line = at(chain, then) - earth
                    then = tt - np.linalg.norm(line) / 299792.458 / 86400.0
                add(ephemeris, name, tt, line * 1000.0, (at(chain, then) - at([(0, 10)], then)) * 1000.0)
    for i in range(60):
        date = ephem.Date(ephem.Date("1990/01/03 05:00:00") + i * 303.37)
        tt = date + 2415020.0 + ephem.delta_t(date) / 86400.0
        for name in PLANETS:
            target = getattr(ephem, name)()
            target.compute(date, epoch=ephem.J2000)
            unit = lambda ra, dec: np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
            line = unit(target.a_ra, target.a_dec) * target.earth_distance * 149597870700.0
            sun = ephem.Sun()
            sun.compute(date, epoch=ephem.J2000)
            from_sun = line - unit(sun.a_ra, sun.a_dec) * sun.earth_distance * 149597870700.0
            add("libastro", name, tt, line, from_sun)
    lat, lon, height = SITES["ufo"]
    location = EarthLocation.from_geodetic(lon * u.deg, lat * u.deg, height * u.m, ellipsoid="WGS84")
    for text, values in EPOCHS.items():
        ConstantEarth.values = values
        iers.earth_orientation_table.set(ConstantEarth())
        time = Time(text, scale="utc", precision=9)
        for ephemeris in ["builtin"] + (["DE430"] if text.startswith("2015-03-03") else []):
            solar_system_ephemeris.set("builtin" if ephemeris == "builtin" else skyfield_data("de430-2015-03-02.bsp"))
            for name in PLANETS:
                place = get_body(name.lower() if ephemeris == "builtin" else PLANETS[name][0], time, location).transform_to(AltAz(obstime=time, location=location, pressure=0 * u.hPa))
                rows.append((f"astropy {ephemeris}", name, time.tt.jd, np.nan, np.nan, place.distance.to_value(u.m), np.nan, text + "Z", place.az.deg, place.alt.deg))
    names = "ephemeris,body,jd_tt,ra_deg,dec_deg,distance_m,v_mag,epoch_utc,azimuth_deg,altitude_deg".split(",")
    return Table(rows=rows, names=names), (
        "Mercury to Saturn: from the Earth's centre (light time, no aberration, ICRS axes) with V magnitudes; by astropy apparent azimuth and altitude at the site ufo of "
        "places.ecsv, with its Earth orientation")


def add_line(rows, name, body, tt, line_m):
    ra = np.degrees(np.arctan2(line_m[1], line_m[0])) % 360.0
    dec = np.degrees(np.arctan2(line_m[2], np.hypot(line_m[0], line_m[1])))
    rows.append((name, body, float(tt), ra, dec, np.linalg.norm(line_m)))


def main():
    what, repository = sys.argv[1], sys.argv[2]
    iers.conf.auto_download = False
    table, title = {"places": places, "frames": frames, "orientation": orientation, "bodies": bodies, "planets": planets}[what](repository)
    table.meta["title"] = title
    table.meta["source"] = f"radiometry/tests/peers/sky.py {what}, with {versions()}, numpy {np.__version__}"
    table.write(sys.stdout, format="ascii.ecsv", delimiter=",")


main()
