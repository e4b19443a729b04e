"""Frames of a satellite among stars, made with numpy, scipy and astropy (synthetic): the truth of tests of zero points.

    star_frames.py FOLDER KIND WCS FRAMES SEED MAGNITUDE [STARS [PROGRAM]]

KIND is `sidereal` (stars are points, the target a streak) or `tracked` (stars are trailed, the target is a point). WCS is `header`, `shifted` (coordinates off by 25 px) or `none`
(the header has the mount's pointing and the focal length). STARS is how many are drawn on five times the frame's area. PROGRAM is 0 to 4: N.I.N.A., MaxIm DL, SharpCap, Ekos, ASIAIR, whose
headers are imitated; without it each frame only says another name. Writes light_N.fits, stars.csv and truth.json; MAGNITUDE is the target's, about which it varies by 0.6. The profile of a point is a Moffat's of
beta 3, whose wings a normal profile does not have; a fifth of the frames has clouds of 0.3 to 1.5 mag; the filter has a colour term of -0.08; each star is off by its own 0.015 mag.

Points and trails are summed as waves: the transform of the Moffat profile (of its Bessel function), of a pixel and of a trail are closed forms, so that all light is drawn, without steps. The profile
is a little undersampled: the waves beyond a pixel's are left out, 1e-3 of a point's at the end.
"""
import json
import sys

import numpy as np
from astropy.io import fits
from astropy.wcs import WCS
from scipy.special import kv

folder, kind, coordinates, count, seed = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]), int(sys.argv[5])
brightness = float(sys.argv[6])
n = int(sys.argv[7]) if len(sys.argv) > 7 else 260
program = int(sys.argv[8]) if len(sys.argv) > 8 else None
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

# Waves on a frame with a border, so that light from beyond an edge does not come back at the other.
border = 130
full = (width + 2 * border, height + 2 * border)
kx = 2 * np.pi * np.fft.fftfreq(full[0])[:, None]
ky = 2 * np.pi * np.fft.rfftfreq(full[1])[None, :]
k = alpha * np.hypot(kx, ky)
k[0, 0] = 1e-6
point = 0.5 * k**2 * kv(2, k) * np.sinc(kx / (2 * np.pi)) * np.sinc(ky / (2 * np.pi))


def drawn(x, y, flux, trail=(0.0, 0.0)):
    """Points, or trails about these places."""
    x, y, flux = (np.atleast_1d(v).astype(float) for v in (x, y, flux))
    near = (x > -border) & (x < width + border) & (y > -border) & (y < height + border)
    x, y, flux = x[near] + border, y[near] + border, flux[near]
    waves = np.exp(-1j * kx * x[None, :]) @ (flux[:, None] * np.exp(-1j * y[:, None] * ky))
    waves *= point * np.sinc((kx * trail[0] + ky * trail[1]) / (2 * np.pi))
    image = np.fft.irfft2(waves, s=full)
    return image[border : border + width, border : border + height].T


def sexagesimal(degrees, sign=False):
    left = round(abs(degrees) * 360000) / 360000
    whole = int(left)
    minutes = (left - whole) * 60
    text = f"{whole:02d} {int(minutes):02d} {(minutes - int(minutes)) * 60:05.2f}".replace("60.00", "59.99")
    return ("-" if degrees < 0 else "+") + text if sign else text


def of_program(h, ra, dec, focal, start):
    """Cards as these programs write them, by their files and documentation."""
    second = start % 60
    stamp = f"2026-03-04T20:{int(start // 60):02d}:{second:06.3f}"
    middle = start + exposure / 2
    hours, degrees = sexagesimal(ra / 15), sexagesimal(dec, sign=True)
    if program == 0:
        h["SWCREATE"] = "N.I.N.A. 3.1.2.9001 (x64)"
        h["IMAGETYP"] = "LIGHT"
        h["EXPOSURE"] = h["EXPTIME"] = exposure
        h["DATE-LOC"] = stamp.replace("T20", "T21")
        h["DATE-OBS"] = stamp
        h["DATE-AVG"] = f"2026-03-04T20:{int(middle // 60):02d}:{middle % 60:06.3f}"
        h["GAIN"], h["OFFSET"], h["EGAIN"] = 100, 50, gain
        h["XBINNING"] = h["YBINNING"] = 1
        h["RA"], h["DEC"], h["OBJCTRA"], h["OBJCTDEC"] = ra, dec, hours, degrees
        h["ROWORDER"] = "TOP-DOWN"
    elif program == 1:
        h["SWCREATE"] = "MaxIm DL Version 6.20 160907 0GY3S"
        h["IMAGETYP"] = "Light Frame"
        h["DATE-OBS"] = stamp[:-1]
        h["EXPTIME"] = h["EXPOSURE"] = exposure
        h["XBINNING"] = h["YBINNING"] = 1
        h["XORGSUBF"] = h["YORGSUBF"] = 0
        h["EGAIN"] = gain
        h["OBJCTRA"], h["OBJCTDEC"] = hours, degrees
        h["JD"] = 2461104.333333333 + start / 86400
        h["CBLACK"], h["CWHITE"], h["CSTRETCH"] = 580, 900, "Medium"
    elif program == 2:
        h["SWCREATE"] = "SharpCap v4.1.11982.0, 64 bit"
        h["FRAMETYP"] = "Light"
        h["EXPTIME"] = exposure
        h["DATE-OBS"] = (stamp + "0000", "System Clock:Est. Frame Start")
        h["GAIN"], h["BLKLEVEL"], h["EGAIN"] = 120, 30, gain
        h["XBINNING"] = h["YBINNING"] = 1
        h["RA"], h["DEC"], h["OBJCTRA"], h["OBJCTDEC"] = ra, dec, hours, degrees
    elif program == 3:
        h["INSTRUME"] = "ZWO CCD ASI294MM Pro"
        h["FRAME"] = "Light"
        h["IMAGETYP"] = "Light Frame"
        h["EXPTIME"] = exposure
        h["PIXSIZE1"] = h["PIXSIZE2"] = 3.76
        h["XBINNING"] = h["YBINNING"] = 1
        h["GAIN"], h["OFFSET"], h["EGAIN"] = 100.0, 30.0, gain
        h["SCALE"] = 206.265 * 3.76 / focal
        h["OBJCTRA"], h["OBJCTDEC"], h["RA"], h["DEC"], h["EQUINOX"] = " " + hours, degrees, ra, dec, 2000
        h["DATE-OBS"] = stamp
        h["COMMENT"] = "Generated by INDI"
    else:
        h["CREATOR"] = "ZWO ASIAIR Plus"
        h["IMAGETYP"] = "Light"
        h["EXPOSURE"] = h["EXPTIME"] = exposure
        h["DATE-OBS"] = stamp + "000"
        h["XBINNING"] = h["CCDXBIN"] = 1
        h["GAIN"], h["OFFSET"], h["EGAIN"] = 100, 10, gain
        h["RA"], h["DEC"] = ra, dec


truth = []
speed = 22.0  # px/s
angle = rng.uniform(0, 2 * np.pi)
motion = speed * np.array([np.cos(angle), np.sin(angle)])
target_colour = rng.normal(sun, 0.2)
at = field.all_world2pix(sky, 0)
for i in range(count):
    cloud = rng.uniform(0.3, 1.5) if rng.random() < 0.2 else 0.0
    z = zero - cloud
    # M = Z + m + k (c - c0): the rate of a star of colour c.
    flux = exposure * 10 ** (-0.4 * (magnitude + own - z - term * (colour - sun)))
    m = brightness + 0.6 * np.sin(0.4 * i)
    light = exposure * 10 ** (-0.4 * (m - z - term * (target_colour - sun)))
    trail = exposure * motion
    if kind == "sidereal":
        # Frames of several passes: the streak lies somewhere inside.
        middle = np.array([width / 2, height / 2]) + motion / speed * (i - count / 2) * 12
        image = drawn(at[:, 0], at[:, 1], flux) + drawn(middle[0], middle[1], light, trail)
    else:
        middle = np.array([width / 2 + 3 * np.sin(i), height / 2 + 3 * np.cos(i)])
        image = drawn(at[:, 0], at[:, 1], flux, trail) + drawn(middle[0], middle[1], light)
    image += level
    image = rng.poisson(np.clip(image, 0, None) * gain) / gain + rng.normal(0, noise, image.shape)
    pixels = np.clip(np.round(image), 0, 65535).astype("u2")
    hdu = fits.PrimaryHDU(pixels)
    h = hdu.header
    start = 10 * i + 0.25
    focal = 3.76e-3 / np.tan(np.radians(scale / 3600))
    # Of a mount that is not solved: two hundred px off, and a focal length that is wrong by 3 %.
    off = coordinates == "none"
    pointing = (ra0 + (200 * scale / 3600 / np.cos(np.radians(dec0)) if off else 0.0)) % 360
    if program is None:
        h["SWCREATE"] = ["N.I.N.A. 3.1.2.9001 (x64)", "MaxIm DL Version 6.20", "SharpCap v4.1", "KStars/Ekos", "ASIStudio"][i % 5]
        h["IMAGETYP"] = "LIGHT"
        h["DATE-OBS"] = f"2026-03-04T20:{i // 6:02d}:{10 * (i % 6):02d}.250"
        h["EXPTIME"] = exposure
        h["EGAIN"] = gain
        if off:
            h["OBJCTRA"], h["OBJCTDEC"] = pointing, dec0
    else:
        of_program(h, pointing, dec0, focal, start)
    h["FILTER"] = "V"
    if off or program is not None:
        h["XPIXSZ"] = 3.76
        h["FOCALLEN"] = round(focal * (1.03 if off else 1.0), 1)
    solved = field.to_header()
    if coordinates == "shifted":
        solved["CRPIX1"] += 20
        solved["CRPIX2"] -= 15
    if not off:
        h.update(solved)
    hdu.writeto(f"{folder}/light_{i:03d}.fits")
    ra, dec = field.all_pix2world([middle], 0)[0]
    truth.append({
        "file": f"light_{i:03d}.fits",
        "kind": kind,
        "magnitude": m,
        "zero": z,
        "sky": [float(ra), float(dec)],
        "cloud": cloud,
        "middle_s": start + exposure / 2,
        # For another program, which is told where everything is.
        "place": [float(v) for v in middle],
        "trail": [float(v) for v in trail],
        "stars": [[float(x), float(y), float(v), float(c)] for (x, y), v, c in zip(at, magnitude, colour)],
    })
json.dump(truth, open(f"{folder}/truth.json", "w"))
