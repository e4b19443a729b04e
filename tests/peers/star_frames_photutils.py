"""Magnitudes of the frames of star_frames.py by photutils and astropy, as one would write it in a page of Python: the peer of `sunglint reduce FOLDER`.

    star_frames_photutils.py FOLDER

Is told where everything is (truth.json: the places of the stars and of the target, the trail), which sunglint has to find. Measures sums in apertures: circles of 2 widths about points, rectangles as far
about trails, with a clipped median of an annulus or a rectangle around; stars without a neighbour that adds 2 %, zero point and colour term by clipped least squares, the target taken as the Sun. Prints a list with
`magnitude`, `sigma` and `stars` (`null` with fewer than three).
"""
import json
import sys

import numpy as np
from astropy.io import fits
from astropy.stats import SigmaClip
from photutils.aperture import (
    ApertureStats,
    CircularAnnulus,
    CircularAperture,
    RectangularAnnulus,
    RectangularAperture,
    aperture_photometry,
)

folder = sys.argv[1]
radius, clip, sun = 6.4, SigmaClip(3.0), 0.653


def measured(pixels, places, trail, gain):
    """Light and its variance in apertures about points or trails."""
    length, angle = np.hypot(*trail), np.arctan2(trail[1], trail[0])
    if length == 0:
        inner = CircularAperture(places, radius)
        around = CircularAnnulus(places, 3 * radius, 5 * radius)
    else:
        w, h = length + 2 * radius, 2 * radius
        inner = RectangularAperture(places, w, h, theta=angle)
        around = RectangularAnnulus(places, w + 2 * radius, w + 6 * radius, 6 * h, h_in=3 * h, theta=angle)
    sky = ApertureStats(pixels, around, sigma_clip=clip, sum_method="subpixel", subpixels=1)
    light = np.asarray(aperture_photometry(pixels, inner, method="subpixel", subpixels=10)["aperture_sum"]) - sky.median * inner.area
    around_n = np.asarray(sky.sum_aper_area.value)
    variance = np.maximum(light, 0) / gain + sky.std**2 * inner.area * (1 + 1.57 * inner.area / around_n)
    return light, variance


result = []
for truth in json.load(open(f"{folder}/truth.json")):
    with fits.open(f"{folder}/{truth['file']}") as file:
        pixels, gain = file[0].data.astype(float), file[0].header["EGAIN"]
    exposure = 4.0
    height, width = pixels.shape
    stars = np.array(truth["stars"])
    trail = np.array(truth["trail"])
    # The streak in a frame with a point as stars; a point in a frame with trailed stars.
    sidereal = truth["kind"] == "sidereal"
    none = np.zeros(2)
    star_trail, own_trail = (none, trail) if sidereal else (trail, none)
    half = np.abs(star_trail) / 2 + 2 * radius
    inside = np.all((stars[:, :2] > half) & (stars[:, :2] < np.array([width, height]) - half), axis=1)
    relative = 10 ** (-0.4 * stars[:, 2])
    # Along the trail's direction and across it.
    unit = star_trail / np.hypot(*star_trail) if np.any(star_trail) else np.array([1.0, 0.0])
    apart = stars[:, None, :2] - stars[None, :, :2]
    along = np.abs(apart @ unit)
    across = np.abs(apart @ np.array([-unit[1], unit[0]]))
    near = (along < np.hypot(*star_trail) + 2.5 * radius) & (across < 2.5 * radius)
    np.fill_diagonal(near, False)
    alone = near @ relative < 0.02 * relative
    # Nor beneath the target.
    d = stars[:, :2] - np.array(truth["place"])
    unit = trail / np.hypot(*trail)
    reach = np.hypot(*trail) + 4 * radius
    clear = (np.abs(d @ unit) > reach) | (np.abs(d @ np.array([-unit[1], unit[0]])) > 4 * radius)
    use = stars[inside & alone & clear]
    light, variance = measured(pixels, use[:, :2], star_trail, gain) if len(use) else (np.array([]), np.array([]))
    good = (light > 0) & (np.sqrt(variance) < 0.1 * light) if len(use) else np.array([], bool)
    use, light, variance = use[good], light[good], variance[good]
    if len(use) < 3:
        result.append(None)
        continue
    y = use[:, 2] + 2.5 * np.log10(light / exposure)
    weight = 1 / ((1.0857**2) * variance / light**2 + 0.02**2)
    keep = np.ones(len(use), bool)
    for _ in range(5):
        columns = [np.ones(keep.sum())] + ([use[keep, 3] - sun] if keep.sum() >= 8 else [])
        a = np.stack(columns, axis=1)
        normal = a.T @ (weight[keep, None] * a)
        x = np.linalg.solve(normal, a.T @ (weight[keep] * y[keep]))
        term = x[1] if len(x) > 1 else 0.0
        left = y - x[0] - term * (use[:, 3] - sun)
        scatter = 1.4826 * np.median(np.abs(left[keep] - np.median(left[keep])))
        further = np.abs(left) < 3 * np.maximum(scatter, np.sqrt(1 / weight))
        if further.sum() < 3 or np.array_equal(further, keep):
            break
        keep = further
    own, own_variance = measured(pixels, [truth["place"]], own_trail, gain)
    if own[0] <= 0:
        result.append(None)
        continue
    sigma = np.sqrt(1.0857**2 * own_variance[0] / own[0] ** 2 + np.linalg.inv(normal)[0, 0] + (0.2 * 0.08) ** 2)
    result.append({"magnitude": float(x[0] - 2.5 * np.log10(own[0] / exposure)), "sigma": float(sigma), "stars": int(keep.sum())})
print(json.dumps(result))
