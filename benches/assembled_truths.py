#!/usr/bin/env python3
"""Asks Mitsuba 3 for the values of materials that were assembled from samples, and writes fixtures/bsdf/assembled.csv; with --spheres it
renders spheres of them, for fixtures/bsdf/assembled_spheres.csv.

    cargo run -p sunglint-materials --example assembled_files -- FOLDER
    python3 -m venv PEER && PEER/bin/pip install mitsuba==3.9.1 numpy
    DRJIT_LIBLLVM_PATH=... PEER/bin/python benches/assembled_truths.py FOLDER > fixtures/bsdf/assembled.csv
    DRJIT_LIBLLVM_PATH=... PEER/bin/python benches/assembled_truths.py FOLDER --spheres > fixtures/bsdf/assembled_spheres.csv

Each line: file, direction to the light, direction to the observer (unit vectors, z the normal), f_r cos(theta_o) at 400, 550 and 800 nm.
Of a sphere of 1 m radius: file, phase angle (degrees), radiant intensity (W/sr per W/m2) at the same wavelengths.
"""
import sys
import numpy as np
import mitsuba as mi

mi.set_variant("llvm_ad_spectral")
COUNT = 600
# Degrees of light and observer from the normal.
MOST_DEG = 88
NM = (400.0, 550.0, 800.0)

NAMES = ("lambert", "beckmann", "ggx", "glossy")


def sphere(path, phase_deg, side=512, rays=256):
    """The sum over an orthographic picture of a sphere under a collimated light."""
    aside = np.radians(phase_deg)
    film = {"type": "specfilm", "width": side, "height": side, "rfilter": {"type": "box"}}
    for nm in NM:
        # Bands of 2 nm: the spectrum is linear across them.
        film[f"band{nm:.0f}"] = {"type": "regular", "wavelength_min": nm - 1, "wavelength_max": nm + 1, "values": "1, 1"}
    view = mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
    light = {"type": "uniform", "value": 1.0, "wavelength_min": 300.0, "wavelength_max": 900.0}
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
        "sensor": {"type": "orthographic", "to_world": view, "film": film, "sampler": {"type": "multijitter", "sample_count": rays}},
        "sphere": {"type": "sphere", "bsdf": {"type": "measured", "filename": path}},
        "light": {"type": "directional", "direction": [-np.sin(aside), 0, -np.cos(aside)], "irradiance": light},
    })
    # The picture is 2 m wide; a band's value is its integral over 2 nm.
    return np.array(mi.render(scene)).mean((0, 1)) * 4 / 2


if "--spheres" in sys.argv:
    print(f"# Mitsuba {mi.__version__}, `measured` on a `sphere`, integrator `direct`, variant llvm_ad_spectral; see benches/assembled_truths.py")
    print("file,phase_deg,intensity_400,intensity_550,intensity_800")
    for name in NAMES[:3]:
        for phase_deg in (10, 30, 60, 90, 120, 150):
            value = sphere(f"{sys.argv[1]}/{name}.bsdf", phase_deg)
            print(f"{name},{phase_deg}," + ",".join(f"{v:.6e}" for v in value))
    sys.exit()

rng = np.random.default_rng(12)
theta_i = np.radians(rng.uniform(0, MOST_DEG, COUNT))
theta_o = np.radians(rng.uniform(0, MOST_DEG, COUNT))
phi_o = rng.uniform(-np.pi, np.pi, COUNT)
# Half of all near the mirrored direction.
near = np.arange(COUNT) % 2 == 0
theta_o[near] = np.clip(theta_i[near] + np.radians(rng.normal(0, 8, near.sum())), 0, np.radians(MOST_DEG))
phi_o[near] = np.pi + np.radians(rng.normal(0, 15, near.sum()))
unit = lambda t, p: np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])
i, o = unit(theta_i, np.zeros(COUNT)), unit(theta_o, phi_o)

print(f"# Mitsuba {mi.__version__}, plug-in `measured`, variant llvm_ad_spectral; see benches/assembled_truths.py")
print("file,ix,iy,iz,ox,oy,oz,f_cos_400,f_cos_550,f_cos_800")
for name in NAMES:
    bsdf = mi.load_dict({"type": "measured", "filename": f"{sys.argv[1]}/{name}.bsdf"})
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*i.astype(np.float32))
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.wavelengths = mi.Spectrum([*NM, NM[1]])
    value = np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*o.astype(np.float32)), True))
    for k in range(COUNT):
        text = ",".join(f"{v:.7f}" for v in (*i[:, k], *o[:, k]))
        print(f"{name},{text}," + ",".join(f"{value[c, k]:.6e}" for c in range(3)))
