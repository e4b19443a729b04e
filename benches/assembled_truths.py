#!/usr/bin/env python3
"""Asks Mitsuba 3 for the values of materials that were assembled from samples, and writes fixtures/bsdf/assembled.csv.

    cargo run -p sunglint-calibration --example assembled_files -- FOLDER
    python3 -m venv PEER && PEER/bin/pip install mitsuba==3.9.1 numpy
    DRJIT_LIBLLVM_PATH=... PEER/bin/python benches/assembled_truths.py FOLDER > fixtures/bsdf/assembled.csv

Each line: file, direction to the light, direction to the observer (unit vectors, z the normal), f_r cos(theta_o) at 400, 550 and 800 nm.
"""
import sys
import numpy as np
import mitsuba as mi

mi.set_variant("llvm_ad_spectral")
COUNT = 400
NM = (400.0, 550.0, 800.0)

rng = np.random.default_rng(12)
theta_i = np.radians(rng.uniform(0, 80, COUNT))
theta_o = np.radians(rng.uniform(0, 80, COUNT))
phi_o = rng.uniform(-np.pi, np.pi, COUNT)
# Half of all near the mirrored direction.
near = np.arange(COUNT) % 2 == 0
theta_o[near] = np.clip(theta_i[near] + np.radians(rng.normal(0, 8, near.sum())), 0, np.radians(80))
phi_o[near] = np.pi + np.radians(rng.normal(0, 15, near.sum()))
unit = lambda t, p: np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])
i, o = unit(theta_i, np.zeros(COUNT)), unit(theta_o, phi_o)

print(f"# Mitsuba {mi.__version__}, plug-in `measured`, variant llvm_ad_spectral; see benches/assembled_truths.py")
print("file,ix,iy,iz,ox,oy,oz,f_cos_400,f_cos_550,f_cos_800")
for name in ("lambert", "beckmann", "ggx"):
    bsdf = mi.load_dict({"type": "measured", "filename": f"{sys.argv[1]}/{name}.bsdf"})
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*i.astype(np.float32))
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.wavelengths = mi.Spectrum([*NM, NM[1]])
    value = np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*o.astype(np.float32)), True))
    for k in range(COUNT):
        text = ",".join(f"{v:.7f}" for v in (*i[:, k], *o[:, k]))
        print(f"{name},{text}," + ",".join(f"{value[c, k]:.6e}" for c in range(3)))
