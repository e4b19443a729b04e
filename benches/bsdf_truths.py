#!/usr/bin/env python3
"""Asks Mitsuba 3 for the values of `.bsdf` files and writes fixtures/bsdf/mitsuba.csv.

    cargo run -p sunglint-simulator --example bsdf_files -- FOLDER
    python3 -m venv PEER && PEER/bin/pip install mitsuba==3.9.1 numpy
    DRJIT_LIBLLVM_PATH=... PEER/bin/python benches/bsdf_truths.py FOLDER > fixtures/bsdf/mitsuba.csv

Each line: file, direction to the light, direction to the observer (unit vectors, z the normal), f_r cos(theta_o) at 400, 550 and 800 nm,
and the density (1/sr) with which the plug-in draws that direction.
"""
import sys
import numpy as np
import mitsuba as mi

mi.set_variant("llvm_ad_spectral")
COUNT = 240
NM = (400.0, 550.0, 800.0)


def directions():
    rng = np.random.default_rng(4)
    theta_i = np.radians(rng.uniform(0, 88, COUNT))
    phi_i = rng.uniform(-np.pi, np.pi, COUNT)
    theta_o = np.radians(rng.uniform(0, 89.5, COUNT))
    phi_o = rng.uniform(-np.pi, np.pi, COUNT)
    # A third near the mirrored direction, a sixth of all grazing.
    near = np.arange(COUNT) % 3 == 0
    theta_o[near] = np.clip(theta_i[near] + np.radians(rng.normal(0, 6, near.sum())), 0, np.radians(89.5))
    phi_o[near] = phi_i[near] + np.pi + np.radians(rng.normal(0, 6, near.sum()))
    grazing = np.arange(COUNT) % 6 == 1
    theta_i[grazing] = np.radians(rng.uniform(80, 88, grazing.sum()))
    theta_o[grazing] = np.radians(rng.uniform(80, 89.5, grazing.sum()))
    unit = lambda t, p: np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])
    return unit(theta_i, phi_i), unit(theta_o, phi_o)


i, o = directions()
print(f"# Mitsuba {mi.__version__}, plug-in `measured`, variant llvm_ad_spectral; see benches/bsdf_truths.py")
print("file,ix,iy,iz,ox,oy,oz,f_cos_400,f_cos_550,f_cos_800,density_per_sr")
for name in ("lambert", "beckmann", "ggx", "ward", "two_fold"):
    bsdf = mi.load_dict({"type": "measured", "filename": f"{sys.argv[1]}/{name}.bsdf"})
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*i.astype(np.float32))
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.wavelengths = mi.Spectrum([*NM, NM[1]])
    ctx = mi.BSDFContext()
    out = mi.Vector3f(*o.astype(np.float32))
    value = np.array(bsdf.eval(ctx, si, out, True))
    density = np.array(bsdf.pdf(ctx, si, out, True))
    for k in range(COUNT):
        row = [*i[:, k], *o[:, k]]
        text = ",".join(f"{v:.7f}" for v in row)
        print(f"{name},{text}," + ",".join(f"{value[c, k]:.6e}" for c in range(3)) + f",{density[k]:.6e}")
