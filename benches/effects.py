"""Called by benches/against_mitsuba --effects: EXAMPLE PEER BSDF_FOLDER. The engine's effects beside Mitsuba; prints a table.

Scenes: the corner and the diffuse box-wing, all orders of scattering; the box-wing under a Sun of 0.2666 degrees' radius; a sphere of a measured
material. Truths: exact sums of the peer script for single scattering; for more, the stored long renders (simulator/scenes/bounce.ecsv);
for the disc the exact sums averaged over it (ours is darkened towards its limb, Mitsuba's is even); for the measured sphere the file's
values as Mitsuba evaluates them, summed over the sphere by quadrature.
"""
import csv, importlib.metadata, importlib.util, json, math, os, pathlib, statistics, subprocess, sys, tempfile, time
import numpy as np

TOP = pathlib.Path(__file__).resolve().parent.parent
SPP = [4, 16, 64, 256, 1024]
REPEATS = 5
PX = 60
ANGLE = math.radians(.2666)


def rows(path):
    with open(path) as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def all_orders(peer, base):
    """Exact single scattering, and the first stored row of the rest (its standard error is below 1e-4 of it)."""
    stored = next(r for r in rows(TOP / "simulator/scenes/bounce.ecsv") if r["scene"] == base)
    exact = [r for r in rows(TOP / "simulator/scenes/exact.ecsv") if r["scene"] == base]
    direct = sum(peer.grey(r["material"]) * float(r["weight_m2_sr"]) for r in exact)
    return direct + float(stored["bounce_m2_sr"])


def disc(peer, scene, smith, limb, rings=3, around=8):
    """Exact sums averaged over a disc of brightness 1 - u (1 - mu): Gauss-Legendre in the square of the radius, even steps around."""
    peer.SMITH = smith
    x, w = np.polynomial.legendre.leggauss(rings)
    sun = peer.unit(scene["sun_dir"])
    a = peer.unit(np.cross(sun, [0.3, 0.5, 0.8])); b = np.cross(sun, a)
    total = weight = 0.0
    for xi, wi in zip(x, w):
        square = .5 * (xi + 1); bright = 1 - limb * (1 - math.sqrt(1 - square))
        for k in range(around):
            phi = 2 * math.pi * (k + .5) / around
            r = math.tan(ANGLE) * math.sqrt(square)
            moved = dict(scene, sun_dir=peer.unit(sun + r * (math.cos(phi) * a + math.sin(phi) * b)))
            G = peer.exact_direct(moved)
            total += wi * bright * sum(peer.grey(m) * g for m, g in G.items()); weight += wi * bright
    return total / weight


def sphere_truth(mi, bsdf, sun, view, n=700):
    """Sum over a unit sphere of f cos cos at 550 nm, in the coordinates in which the lit and seen lune is a rectangle."""
    phase = math.acos(float(np.dot(sun, view)))
    x, w = np.polynomial.legendre.leggauss(n)
    # Longitude from the observer in the plane of both, latitude across it.
    lo, hi = phase - math.pi / 2, math.pi / 2
    lon = .5 * (hi - lo) * x + .5 * (hi + lo); lw = .5 * (hi - lo) * w
    lat = .5 * math.pi * x; bw = .5 * math.pi * w * np.cos(lat)
    L, B = np.meshgrid(lon, lat, indexing="ij"); W = np.outer(lw, bw).ravel()
    nrm = np.stack([np.cos(B) * np.cos(L), np.cos(B) * np.sin(L), np.sin(B)], -1).reshape(-1, 3)
    to, light = np.array([1., 0, 0]), np.array([math.cos(phase), math.sin(phase), 0])
    t = np.cross(nrm, [0, 0, 1.]); t /= np.linalg.norm(t, axis=1)[:, None]; s = np.cross(nrm, t)
    local = lambda d: np.stack([t @ d, s @ d, nrm @ d])
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*local(to).astype(np.float32))
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.wavelengths = mi.Spectrum(550.0)
    value = np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*local(light).astype(np.float32)), True))
    return float(np.sum(value[0] * np.clip(nrm @ to, 0, None) * W))


def timed(fn, truth):
    fn(0)
    values, seconds = [], []
    for seed in range(REPEATS):
        start = time.process_time(); values.append(fn(seed + 1)); seconds.append(time.process_time() - start)
    return statistics.median(seconds), float(np.sqrt(np.mean((np.array(values) / truth - 1) ** 2)))


def mono(peer, mi, scene, spp, **kw):
    with tempfile.TemporaryDirectory() as folder:
        fn, _ = peer.make_renderer(mi, scene, "mono", folder, PX, 1, spp, sampler="multijitter", **kw)
        return lambda seed: float(fn(seed)[0])


def measured(mi, dr, sun, view, file, spp):
    """The sphere at 550 nm: rays made by hand, as the peer script does it for spectra."""
    T = mi.ScalarTransform4f
    up = [0, 0, 1]
    scene = mi.load_dict({
        "type": "scene", "integrator": {"type": "path", "max_depth": 2},
        "sensor": {"type": "orthographic", "to_world": T().look_at(origin=(5 * view).tolist(), target=[0, 0, 0], up=up) @ T().scale([1.01, 1.01, 1]),
                   "film": {"type": "hdrfilm", "width": PX, "height": PX}},
        "sun": {"type": "directional", "direction": (-sun).tolist(), "irradiance": {"type": "uniform", "value": 1.0}},
        "sphere": {"type": "sphere", "bsdf": {"type": "measured", "filename": file}}})
    integrator, sensor, n = scene.integrator(), scene.sensors()[0], PX * PX * spp

    def fn(seed):
        sampler = mi.load_dict({"type": "independent"}); sampler.seed(seed, n)
        pix = dr.arange(mi.UInt32, n) // spp
        pos = mi.Point2f((mi.Float(pix % PX) + sampler.next_1d()) / PX, (mi.Float(pix // PX) + sampler.next_1d()) / PX)
        ray, _ = sensor.sample_ray_differential(0., .5, pos, mi.Point2f(.5))
        ray.wavelengths = type(ray.wavelengths)(550.0)
        spectrum, valid, _ = integrator.sample(scene, sampler, ray)
        total = dr.sum(dr.select(valid, spectrum[0], 0.)); dr.eval(total); dr.sync_thread()
        return float(total[0]) * (2 * 1.01 / PX) ** 2 / spp
    return fn


def main():
    example, path, folder = sys.argv[1:4]
    spec = importlib.util.spec_from_file_location("mitsuba_scenes", path)
    peer = importlib.util.module_from_spec(spec); spec.loader.exec_module(peer)
    import mitsuba as mi, drjit as dr
    from against_mitsuba import time_text, two_digits
    load = [os.getloadavg()[0]]
    print("| scene | way | samples per pixel | time per epoch | error | ratio |\n| --- | --- | ---: | ---: | ---: | ---: |")

    def ours(name, truth, *more):
        done = subprocess.run([example, name, "1.5", *more], stdout=subprocess.PIPE, text=True, check=True)
        kept = []
        for line in done.stdout.splitlines():
            r = json.loads(line)
            error, stated = abs(r["value"] / truth - 1), r["stated"] / r["value"]
            kept.append((r["seconds_per_epoch"], max(error, stated / 3)))
            print("| %s | sunglint, tolerance %.0e |  | %s | %.1e (stated %.1e) |  |" % (
                name, r["tolerance"], time_text(r["seconds_per_epoch"]), error, stated), flush=True)
        return kept

    def theirs(name, way, make, truth, own):
        for spp in SPP:
            seconds, error = timed(make(spp), truth)
            enough = [s for s, e in own if e <= error]
            ratio = two_digits(seconds / min(enough)) if enough else "ours is not as exact"
            print("| %s | Mitsuba, %s | %d | %s | %.1e | %s |" % (name, way, spp, time_text(seconds), error, ratio), flush=True)

    mi.set_variant("llvm_ad_mono"); mi.set_log_level(mi.LogLevel.Error); dr.set_thread_count(1)
    for name, base in (("corner_all_orders", "corner"), ("box_wing_all_orders", "box_wing_diffuse")):
        scene, truth = peer.SCENES[base](), all_orders(peer, base)
        theirs(name, "grey, to 20 orders", lambda spp: mono(peer, mi, scene, spp, max_depth=21), truth, ours(name, truth))
    scene = peer.SCENES["box_wing"]()
    own = ours("box_wing_disc", disc(peer, scene, "exact", .6))
    ours("collimated_box_wing", disc(peer, scene, "exact", .6))
    theirs("box_wing_disc", "grey", lambda spp: mono(peer, mi, scene, spp, max_depth=2, sun="disk"), disc(peer, scene, "rational", 0), own)
    mi.set_variant("llvm_ad_spectral"); dr.set_thread_count(1)
    scene = peer.SCENES["lambert_sphere"]()
    sun, view, file = peer.unit(scene["sun_dir"]), peer.unit(scene["view_dir"]), os.path.join(folder, "beckmann.bsdf")
    truth = sphere_truth(mi, mi.load_dict({"type": "measured", "filename": file}), sun, view)
    own = ours("bsdf_sphere", truth, file)
    theirs("bsdf_sphere", "one wavelength", lambda spp: measured(mi, dr, sun, view, file, spp), truth, own)
    load.append(os.getloadavg()[0])
    print("\nMitsuba %s, one thread each; the load of the %d cores was %.1f to %.1f." % (
        importlib.metadata.version("mitsuba"), os.cpu_count(), min(load), max(load)))


if __name__ == "__main__":
    main()
