#!/usr/bin/env python3
"""Makes the stored truths of inter-reflected light: simulator/scenes/bounce.ecsv.

    python3 benches/bounce_truths.py mitsuba_scenes.py simulator/scenes     # mitsuba 3.9.1, numpy; DRJIT_LIBLLVM_PATH of LLVM 19; some minutes

Each row is what a scene sends to an observer after two or more scatterings, I/E in m2/sr: Mitsuba's path integrator with paths of up to 100
edges less that with single scattering and the same seeds (`llvm_ad_mono`, 60 x 60 pixels, `multijitter`), the mean over passes with its
standard error. Scenes: those of the peer script, and its corner with other materials on its three parts. Directions are in the body's axes.
"""
import datetime, hashlib, importlib.util, math, os, sys, tempfile
import numpy as np

SPP, PASSES, DEPTH = 1024, 12, 100
# name: (scene of the peer script, materials of its shapes in turn or None)
LAMBERT = {"dark": 0.1, "red": 0.3, "half": 0.5, "bright": 0.9}
LOBES = {"satin": (0.4, 0.9), "shiny": (0.15, 0.8)}
CASES = [
    ("corner", "corner", None),
    ("box_wing_diffuse", "box_wing_diffuse", None),
    ("box_wing", "box_wing", None),
    # three wavelengths of one corner whose floor, wall and box have colours of their own
    ("colours_1", "corner", ("bright", "red", "half")),
    ("colours_2", "corner", ("red", "bright", "dark")),
    ("colours_3", "corner", ("half", "half", "bright")),
    ("satin_floor", "corner", ("satin", "grey80", "grey80")),
    ("shiny_wall", "corner", ("half", "shiny", "bright")),
    ("all_satin", "corner", ("satin", "satin", "satin")),
]
VIEWS = {
    "corner": [None, ([1, 0.1, 0.4], [0.5, 0.2, 1]), ([0.3, -0.4, 1], [1, 0.5, 0.2]), ([0.9, 0.8, 0.3], [0.6, 0.6, 0.6])],
    "box_wing_diffuse": [None, ([0.9, -0.5, 0.2], [0.7, 0.3, 0.4]), ([0.2, 1, 0.1], [0.6, 0.9, -0.3])],
    "box_wing": [None, ([0.9, -0.5, 0.2], [0.7, 0.3, 0.4])],
}


def unit(v):
    v = np.asarray(v, float)
    return v / np.linalg.norm(v)


def main(path, out):
    spec = importlib.util.spec_from_file_location("mitsuba_scenes", path)
    peer = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(peer)
    for name, rho in LAMBERT.items():
        peer.MATERIALS[name] = {"model": "lambert", "reflectance": [[300, 1240], [rho, rho]]}
    for name, (alpha, rho) in LOBES.items():
        peer.MATERIALS[name] = {"model": "beckmann", "alpha": alpha, "reflectance": [[300, 1240], [rho, rho]]}
    import mitsuba as mi
    import drjit as dr
    mi.set_variant("llvm_ad_mono")
    mi.set_log_level(mi.LogLevel.Error)
    dr.set_thread_count(int(os.environ.get("THREADS", "1")))
    rows = []
    for name, base, materials in CASES:
        scene = peer.SCENES[base]()
        for shape, material in zip(scene["shapes"], materials or []):
            shape["material"] = material
        R = peer.quat_to_mat(scene["attitude"])
        for view in VIEWS[base]:
            if view is not None:
                scene["sun_dir"], scene["view_dir"] = R @ unit(view[0]), R @ unit(view[1])
            sun, to = R.T @ scene["sun_dir"], R.T @ scene["view_dir"]
            with tempfile.TemporaryDirectory() as tmp:
                deep, _ = peer.make_renderer(mi, scene, "mono", tmp, 60, 1, SPP, sampler="multijitter", max_depth=DEPTH)
                once, _ = peer.make_renderer(mi, scene, "mono", tmp, 60, 1, SPP, sampler="multijitter", max_depth=2)
                found = np.array([deep(k + 1)[0] - once(k + 1)[0] for k in range(PASSES)])
                direct = float(once(0)[0])
            mean, sigma = float(found.mean()), float(found.std(ddof=1) / math.sqrt(PASSES))
            rows.append([name, *map(lambda v: f"{v:.17g}", [*sun, *to]), f"{direct:.6g}", f"{mean:.8g}", f"{sigma:.2g}"])
            print(rows[-1], f"share {mean / (mean + direct):.4f} relative sigma {sigma / mean:.1e}", flush=True)
    columns = [("scene", "", "string")]
    columns += [(f"{w}_{a}", "", "float64") for w in ("sun", "view") for a in "xyz"]
    columns += [(f"{w}_m2_sr", "m2 / sr", "float64") for w in ("direct", "bounce", "sigma")]
    digest = hashlib.sha256(open(path, "rb").read()).hexdigest()[:16]
    head = ["%ECSV 1.0", "---", "delimiter: ','", "datatype:"]
    head += ["- {name: %s, %sdatatype: %s}" % (n, f"unit: {u}, " if u else "", t) for n, u, t in columns]
    head += ["meta: !!omap",
             '- title: "What bench scenes send to an observer after two or more scatterings, I/E, grey"',
             f'- source: "benches/bounce_truths.py with mitsuba_scenes.py (sha256 {digest}...), mitsuba {mi.__version__}, {PASSES} x {SPP} samples per pixel, paths to {DEPTH}, {datetime.date.today()}"',
             '- licence: "CC0-1.0"', "schema: astropy-2.0"]
    with open(os.path.join(out, "bounce.ecsv"), "w") as f:
        f.write("".join(f"# {line}\n" for line in head))
        f.write(",".join(c[0] for c in columns) + "\n")
        f.writelines(",".join(r) + "\n" for r in rows)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
