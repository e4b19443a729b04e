#!/usr/bin/env python3
"""Makes the stored truths of polarised light: simulator/scenes/polarisation.ecsv.

    python3 benches/polarisation_truths.py simulator/scenes/polarisation.ecsv     # mitsuba 3.9.1, numpy; some minutes

A cube of 1 m of a metal like titanium (GGX, alpha 0.25), a wing of 3 m x 1 m of grey Lambert beside it and one of aluminium above it: they shade one another. Each row is
what Mitsuba's `stokes` integrator over `path` with single scattering (`scalar_spectral_polarized`, one wavelength's index at all wavelengths) makes of parallel sunlight: degree and
direction of linear polarisation of the sum over all pixels, with the scatter of the passes. Directions are in the body's axes.
"""
import datetime, os, sys
import numpy as np
import mitsuba as mi

mi.set_variant("scalar_spectral_polarized")
from mitsuba import ScalarTransform4f as T

PIXELS, SPP, PASSES = 64, 64, 6
VIEWS = [
    ([0.3, -0.5, 0.8], [0.1, 0.9, 0.3]), ([0.9, 0.2, 0.3], [0.5, -0.1, 0.8]), ([0.2, 0.7, 0.6], [-0.4, 0.6, 0.5]),
    ([-0.5, 0.1, 0.8], [0.8, 0.3, 0.2]), ([0.6, 0.6, 0.2], [0.6, -0.4, 0.5]), ([1.0, 0.1, 0.4], [-0.2, 0.3, 1.0]),
    ([0.4, 0.4, 1.0], [0.5, 0.3, 0.9]), ([-0.7, -0.6, 0.3], [0.5, -0.8, 0.4]),
]


def metal(n, k, alpha):
    return {"type": "roughconductor", "distribution": "ggx", "alpha": alpha, "sample_visible": True,
            "eta": {"type": "uniform", "value": n}, "k": {"type": "uniform", "value": k}}


def scene(sun, observer):
    sun, observer = (np.array(v) / np.linalg.norm(v) for v in (sun, observer))
    up = [0, 0, 1] if abs(observer[2]) < 0.99 else [0, 1, 0]
    both = lambda bsdf: {"type": "twosided", "bsdf": bsdf}
    return mi.load_dict({
        "type": "scene",
        "integrator": {"type": "stokes", "nested": {"type": "path", "max_depth": 2}},
        "sensor": {"type": "orthographic",
                   "to_world": T().look_at(origin=list(20.0 * observer), target=[0, 0, 0], up=up) @ T().scale([4.0, 4.0, 1.0]),
                   "film": {"type": "hdrfilm", "width": PIXELS, "height": PIXELS, "pixel_format": "luminance", "component_format": "float32",
                            "rfilter": {"type": "box"}},
                   "sampler": {"type": "independent", "sample_count": SPP}},
        "sun": {"type": "directional", "direction": list(-sun), "irradiance": {"type": "uniform", "value": 1.0}},
        "body": {"type": "cube", "to_world": T().scale([0.5, 0.5, 0.5]), "bsdf": metal(2.9, 3.1, 0.25)},
        "wing": {"type": "rectangle", "to_world": T().translate([2.2, 0, 0]) @ T().scale([1.5, 0.5, 1.0]),
                 "bsdf": both({"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.3}})},
        "shield": {"type": "rectangle", "to_world": T().translate([0, 0, 1.0]) @ T().scale([0.75, 0.75, 1.0]), "bsdf": both(metal(0.958, 6.69, 0.35))},
    }), sun, observer


def main(path):
    rows = []
    for sun, observer in VIEWS:
        made, s, o = scene(sun, observer)
        sums = []
        for seed in range(PASSES):
            image = np.array(mi.render(made, seed=seed))
            # luminance, then S0 to S3 as RGB.
            stokes = image[:, :, 1:13].reshape(PIXELS, PIXELS, 4, 3).mean(axis=3)
            sums.append(stokes.sum(axis=(0, 1)))
        sums = np.array(sums)
        mean = sums.mean(axis=0)
        degree = np.hypot(sums[:, 1], sums[:, 2]) / sums[:, 0]
        angle = 0.5 * np.degrees(np.arctan2(mean[2], mean[1])) % 180.0
        # The direction perpendicular to the plane of Sun and observer, in the image: x to the right, y up.
        z = np.array([0.0, 0.0, 1.0])
        y = z - o * o.dot(z)
        y /= np.linalg.norm(y)
        x = np.cross(y, o)
        normal = np.cross(s, o)
        closed = np.degrees(np.arctan2(normal.dot(y), normal.dot(x))) % 180.0
        value = np.hypot(mean[1], mean[2]) / mean[0]
        rows.append([*sun, *observer, value, degree.std(ddof=1) / np.sqrt(PASSES), mean[3] / mean[0], angle, closed])
        print(rows[-1], flush=True)
    names = ["sun_x", "sun_y", "sun_z", "observer_x", "observer_y", "observer_z", "degree", "degree_sigma", "circular", "angle_deg", "perpendicular_deg"]
    with open(path, "w") as file:
        file.write("# %ECSV 1.0\n# ---\n# datatype:\n")
        for name in names:
            file.write("# - {name: %s, datatype: float64}\n" % name)
        made = "made by benches/polarisation_truths.py, Mitsuba %s, %s" % (mi.__version__, datetime.date.today())
        file.write("# meta: {origin: '%s'}\n# schema: astropy-2.0\n" % made)
        file.write(" ".join(names) + "\n")
        for row in rows:
            file.write(" ".join("%.6g" % v for v in row) + "\n")


main(sys.argv[1])
