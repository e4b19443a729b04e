#!/usr/bin/env python3
"""Makes the stored truths of polarised light between surfaces: simulator/scenes/polarisation_bounces.ecsv.

    python3 benches/polarisation_bounces.py simulator/scenes/polarisation_bounces.ecsv     # mitsuba 3.9.1, numpy; half an hour

Targets: a plate, the box-wing (a box of 1 m x 1 m x 2 m, two wings of 0.02 m x 2 m x 1.2 m canted by 12 degrees about z) and a corner of three plates of 1 m. Metals like aluminium and
titanium, and microfacets of n = 1.5 that let nothing through, all in GGX with separable masking and alpha 0.25; grey is Lambert of 0.6. Each row is what Mitsuba's `stokes` integrator over
`path` (`scalar_spectral_polarized`, one wavelength's index at all wavelengths) makes of parallel sunlight, up to 20 scatterings. `q` and `u` are S1/S0
and S2/S0 of the sum over all pixels, counted from the direction perpendicular to the plane of Sun and observer, u counter-clockwise as the observer sees it; their scatter is that of the passes.
`more` is S0 over that of one scattering. Directions are in the body's axes.
"""
import datetime, sys
import numpy as np
import mitsuba as mi

mi.set_variant("scalar_spectral_polarized")
from mitsuba import ScalarTransform4f as T

PIXELS, SPP, PASSES = 48, 256, 16
METALS = {"aluminium": (0.958, 6.69), "titanium": (2.9, 3.1), "glass": (1.5, 0.0)}
BOX_WING = [([0.8, 0.5, 0.3], [0.5, 0.7, -0.4]), ([0.5, 0.3, 0.9], [0.7, 0.3, -0.7]), ([0.9, -0.5, 0.2], [0.3, -0.6, 0.8])]
CORNER = [([0.6, 0.5, 0.7], [0.9, 0.3, 0.3]), ([0.2, 0.9, 0.4], [0.8, 0.3, 0.5]), ([0.9, 0.2, 0.2], [0.2, 0.3, 0.9])]
PLATE = [([0.4, -0.3, 0.7], [-0.5, -0.2, 0.6])]
ORDERS = 20
# Target, materials of its three kinds of parts (body, one wing, the other; planes of x, y and z), directions.
ROWS = [("plate", (m, m, m), PLATE) for m in METALS]
ROWS += [("box_wing", (m, m, m), BOX_WING) for m in METALS]
ROWS += [("box_wing", ("titanium", "grey", "glass"), BOX_WING), ("corner", ("titanium", "aluminium", "glass"), CORNER), ("corner", ("glass", "grey", "aluminium"), CORNER)]


def material(name):
    if name == "grey":
        return {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.6}}
    n, k = METALS[name]
    return {"type": "roughconductor", "distribution": "ggx", "alpha": 0.25, "sample_visible": True,
            "eta": {"type": "uniform", "value": n}, "k": {"type": "uniform", "value": k}}


def parts(target, kinds):
    a, b, c = (material(kind) for kind in kinds)
    half = lambda x, y, z: T().scale([0.5 * x, 0.5 * y, 0.5 * z])
    if target == "plate":
        return {"plate": {"type": "rectangle", "bsdf": a}}
    if target == "box_wing":
        wing = lambda y, bsdf: {"type": "cube", "bsdf": bsdf,
                                "to_world": T().translate([0, y, 0]) @ T().rotate([0, 0, 1], 12) @ half(0.02, 2, 1.2)}
        return {"body": {"type": "cube", "to_world": half(1, 1, 2), "bsdf": a}, "plus": wing(1.6, b), "minus": wing(-1.6, c)}
    # Three plates of 1 m in the planes x = 0, y = 0 and z = 0, facing the first octant.
    side = lambda axis, angle, at, bsdf: {"type": "rectangle", "bsdf": bsdf,
                                          "to_world": T().translate(at) @ T().rotate(axis, angle) @ T().scale([0.5, 0.5, 1])}
    return {"x": side([0, 1, 0], 90, [0, 0.5, 0.5], a), "y": side([1, 0, 0], -90, [0.5, 0, 0.5], b), "z": side([1, 0, 0], 0, [0.5, 0.5, 0], c)}


def sums(target, kinds, depth, sun, observer, seed):
    up = [0, 0, 1] if abs(observer[2]) < 0.99 else [0, 1, 0]
    size, middle = {"plate": (1.5, [0, 0, 0]), "box_wing": (2.9, [0, 0, 0]), "corner": (0.95, [0.5, 0.5, 0.5])}[target]
    middle = np.array(middle)
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "stokes", "nested": {"type": "path", "max_depth": depth, "rr_depth": 50}},
        "sensor": {"type": "orthographic",
                   "to_world": T().look_at(origin=list(middle + 20.0 * observer), target=list(middle), up=up) @ T().scale([size, size, 1.0]),
                   "film": {"type": "hdrfilm", "width": PIXELS, "height": PIXELS, "pixel_format": "luminance", "component_format": "float32",
                            "rfilter": {"type": "box"}},
                   "sampler": {"type": "independent", "sample_count": SPP}},
        "sun": {"type": "directional", "direction": list(-sun), "irradiance": {"type": "uniform", "value": 1.0}},
        **parts(target, kinds)})
    found = []
    for k in range(PASSES):
        image = np.array(mi.render(scene, seed=seed + k))
        found.append(image[:, :, 1:13].reshape(PIXELS, PIXELS, 4, 3).mean(axis=3).sum(axis=(0, 1)))
    return np.array(found)


def main(path):
    rows = []
    for number, (target, kinds, views) in enumerate(ROWS):
        for view, (sun, observer) in enumerate(views):
            s, o = (np.array(v) / np.linalg.norm(v) for v in (sun, observer))
            seed = 1000 * number + 100 * view
            all_of = sums(target, kinds, ORDERS + 1, s, o, seed)
            once = sums(target, kinds, 2, s, o, seed + 50)[:, 0]
            z = np.array([0.0, 0.0, 1.0])
            y = z - o * o.dot(z)
            y /= np.linalg.norm(y)
            x = np.cross(y, o)
            normal = np.cross(s, o)
            turn = np.exp(-2j * np.arctan2(normal.dot(y), normal.dot(x)))
            field = (all_of[:, 1] + 1j * all_of[:, 2]) * turn
            mean = all_of[:, 0].mean()
            # The scatter of the ratio: what is common to numerator and denominator falls out.
            each = field / all_of[:, 0]
            scatter = lambda v: v.std(ddof=1) / np.sqrt(PASSES)
            rows.append([target, *kinds, *sun, *observer, field.mean().real / mean, scatter(each.real), field.mean().imag / mean, scatter(each.imag),
                         abs(all_of[:, 3].mean()) / mean, mean / once.mean(), scatter(all_of[:, 0] / mean) + scatter(once / once.mean())])
            print(rows[-1], flush=True)
    names = ["target", "first", "second", "third", "sun_x", "sun_y", "sun_z", "observer_x", "observer_y", "observer_z", "q", "q_sigma", "u", "u_sigma",
             "circular", "more", "more_sigma"]
    with open(path, "w") as file:
        file.write("# %ECSV 1.0\n# ---\n# datatype:\n")
        for k, name in enumerate(names):
            file.write("# - {name: %s, datatype: %s}\n" % (name, "string" if k < 4 else "float64"))
        made = "made by benches/polarisation_bounces.py, Mitsuba %s, %s" % (mi.__version__, datetime.date.today())
        file.write("# meta: {origin: '%s'}\n# schema: astropy-2.0\n" % made)
        file.write(" ".join(names) + "\n")
        for row in rows:
            file.write(" ".join(v if isinstance(v, str) else "%.6g" % v for v in row) + "\n")


main(sys.argv[1])
