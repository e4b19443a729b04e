"""Frames of a satellite among stars, made with numpy and astropy (synthetic): the truth of tests of zero points.

    star_frames.py FOLDER KIND WCS FRAMES SEED MAGNITUDE

KIND is `sidereal` (stars are points, the target a streak) or `tracked` (stars are trailed, the target is a point). WCS is `header`, `shifted` (coordinates off by 25 px) or `none`
(the header has the mount's pointing and the focal length). Writes light_N.fits, stars.csv and truth.json; MAGNITUDE is the target's, about which it varies by 0.6. The profile of a point is a Moffat's of beta 3, whose wings a normal
profile does not have; a fifth of the frames has clouds of 0.3 to 1.5 mag; the filter has a colour term of -0.08; each star is off by its own 0.015 mag.
"""
import json
import sys

import numpy as np
from astropy.io import fits
from astropy.wcs import WCS

folder, kind, coordinates, count, seed = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]), int(sys.argv[5])
brightness = float(sys.argv[6])
rng = np.random.default_rng(seed)
width, height = 900, 700
fwhm, beta = 3.2, 3.0
alpha = fwhm / (2 * np.sqrt(2 ** (1 / beta) - 1))
scale = 2.4  # arcsec
gain, noise, level = 0.9, 8.0, 600.0
exposure = 4.0
zero, term, sun = 21.3, -0.08, 0.653
turn = rng.uniform(0, 2 * np.pi)
flip = rng.choice([-1.0, 1.0])
ra0, dec0 = rng.uniform(0, 360), rng.uniform(-60, 75)


def header(ra, dec):
    w = WCS(naxis=2)
    w.wcs.ctype = ["RA---TAN", "DEC--TAN"]
    w.wcs.crval = [ra, dec]
    w.wcs.crpix = [width / 2, height / 2]
    c, s = np.cos(turn), np.sin(turn)
    w.wcs.cd = scale / 3600 * np.array([[flip * c, -s], [flip * s, c]])
    w.wcs.radesys = "ICRS"
    return w


# Stars: more faint ones than bright ones, with colours.
n = 260
field = header(ra0, dec0)
places = np.column_stack([rng.uniform(-500, width + 500, n), rng.uniform(-500, height + 500, n)])
sky = field.all_pix2world(places, 0)
magnitude = 9.5 + 6.0 * rng.power(2.2, n)
colour = np.clip(rng.normal(0.75, 0.35, n), -0.2, 1.8)
own = rng.normal(0, 0.015, n)
with open(f"{folder}/stars.csv", "w") as out:
    out.write("RAJ2000,DEJ2000,Vmag,e_Vmag,Bmag\n")
    for (ra, dec), v, c in zip(sky, magnitude, colour):
        out.write(f"{ra:.8f},{dec:.8f},{v:.4f},0.01,{v + c:.4f}\n")

oversampled = 5
sub = (np.arange(oversampled) + 0.5) / oversampled - 0.5


def spread(image, x, y, flux):
    """Adds points of a Moffat profile, averaged over 5 x 5 places in each pixel, 25 px to each side."""
    half = 25
    for px, py, f in zip(np.atleast_1d(x), np.atleast_1d(y), np.atleast_1d(flux)):
        cx, cy = int(round(px)), int(round(py))
        x0, x1, y0, y1 = max(cx - half, 0), min(cx + half + 1, width), max(cy - half, 0), min(cy + half + 1, height)
        if x0 >= x1 or y0 >= y1:
            continue
        gx = (np.arange(x0, x1)[:, None] + sub[None, :]).ravel() - px
        gy = (np.arange(y0, y1)[:, None] + sub[None, :]).ravel() - py
        p = (1 + (gx[None, :] ** 2 + gy[:, None] ** 2) / alpha**2) ** -beta
        p = p.reshape(y1 - y0, oversampled, x1 - x0, oversampled).mean(axis=(1, 3))
        image[y0:y1, x0:x1] += f * p * (beta - 1) / (np.pi * alpha**2)


truth = []
speed = 22.0  # px/s
angle = rng.uniform(0, 2 * np.pi)
motion = speed * np.array([np.cos(angle), np.sin(angle)])
target_colour = rng.normal(sun, 0.2)
for i in range(count):
    cloud = rng.uniform(0.3, 1.5) if rng.random() < 0.2 else 0.0
    z = zero - cloud
    image = np.zeros((height, width))
    if kind == "sidereal":
        w = field
        # Frames of several passes: the streak lies somewhere inside.
        middle = np.array([width / 2, height / 2]) + motion / speed * (i - count / 2) * 12
    else:
        ra, dec = ra0 + 0.0, dec0 + 0.0
        w = field
        middle = np.array([width / 2 + 3 * np.sin(i), height / 2 + 3 * np.cos(i)])
    at = w.all_world2pix(sky, 0)
    flux = exposure * 10 ** (-0.4 * (magnitude + own - z - term * (colour - sun)))
    # M = Z + m + k (c - c0): the rate of a star of colour c.
    if kind == "sidereal":
        spread(image, at[:, 0], at[:, 1], flux)
    else:
        steps = 160
        track = (np.arange(steps) + 0.5) / steps - 0.5
        for (x, y), f in zip(at, flux):
            if -200 < x < width + 200 and -200 < y < height + 200:
                spread(image, x + track * exposure * motion[0], y + track * exposure * motion[1], np.full(steps, f / steps))
    m = brightness + 0.6 * np.sin(0.4 * i)
    light = exposure * 10 ** (-0.4 * (m - z - term * (target_colour - sun)))
    if kind == "sidereal":
        steps = 400
        track = (np.arange(steps) + 0.5) / steps - 0.5
        spread(image, middle[0] + track * exposure * motion[0], middle[1] + track * exposure * motion[1], np.full(steps, light / steps))
    else:
        spread(image, middle[0], middle[1], light)
    image += level
    image = rng.poisson(np.clip(image, 0, None) * gain) / gain + rng.normal(0, noise, image.shape)
    pixels = np.clip(np.round(image), 0, 65535).astype("u2")
    hdu = fits.PrimaryHDU(pixels)
    h = hdu.header
    h["SWCREATE"] = ["N.I.N.A. 3.1.2.9001 (x64)", "MaxIm DL Version 6.20", "SharpCap v4.1", "KStars/Ekos", "ASIStudio"][i % 5]
    h["IMAGETYP"] = "LIGHT"
    h["DATE-OBS"] = f"2026-03-04T20:{i // 6:02d}:{10 * (i % 6):02d}.250"
    h["EXPTIME"] = exposure
    h["FILTER"] = "V"
    h["EGAIN"] = gain
    if coordinates == "none":
        # Two hundred px off, and a focal length that is wrong by 3 %.
        h["OBJCTRA"] = (ra0 + 200 * scale / 3600 / np.cos(np.radians(dec0))) % 360
        h["OBJCTDEC"] = dec0
        h["XPIXSZ"] = 3.76
        h["FOCALLEN"] = 3.76e-3 / np.tan(np.radians(scale / 3600)) * 1.03
    else:
        solved = w.to_header()
        if coordinates == "shifted":
            solved["CRPIX1"] += 20
            solved["CRPIX2"] -= 15
        h.update(solved)
    hdu.writeto(f"{folder}/light_{i:03d}.fits")
    ra, dec = w.all_pix2world([middle], 0)[0]
    truth.append({"magnitude": m, "zero": z, "sky": [float(ra), float(dec)], "cloud": cloud})
json.dump(truth, open(f"{folder}/truth.json", "w"))
