#!/usr/bin/env python3
"""Makes the stored truths of the built-in bench scenes: simulator/scenes/{exact,spectra}.ecsv.

    python3 benches/truths.py mitsuba_scenes.py simulator/scenes     # numpy alone; some minutes, nearly all for dense_satellite

The sums are those of the peer script's own `exact_direct` (polygon subtraction in plain Python), with the closed form of Smith's masking and
with the rational fit that Mitsuba takes. It looks at all pairs of triangles; here its loop over what may hide a facet is given those alone whose
shadow's bounding box meets the facet's, found on a grid: what is left out hides nothing. The large faces of the satellite of 115,244
triangles are split, which changes no sum either. The convex sphere takes its `convex_lambert_truth`. The means of E rho over a bin are by Simpson's rule, exact for a product of two linear pieces.
"""
import datetime, hashlib, importlib.util, inspect, math, os, sys
import numpy as np


def load(path):
    spec = importlib.util.spec_from_file_location("mitsuba_scenes", path)
    peer = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(peer)
    return peer


MASKINGS = ("exact", "rational")
EDGE = 0.06  # m; the satellite's larger triangles are split: what a facet sends does not change, and few shadows fall on each part


def split(mesh):
    """The same surface in triangles whose edges are shorter than EDGE."""
    v, f = mesh
    todo, done = list(v[f]), []
    while todo:
        t = todo.pop()
        if max(np.linalg.norm(t[k] - t[k - 1]) for k in range(3)) < EDGE:
            done.append(t)
            continue
        a, b, c = t
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        todo += [np.array(x) for x in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.concatenate(done), np.arange(3 * len(done)).reshape(-1, 3)


class Near:
    """For each triangle and direction: the numbers of those whose shadows may meet it, in ascending order."""

    def __init__(self, tri, nrm, directions):
        self.t, self.n = np.array([t for _, t in tri]), np.array(nrm)
        self.maps = {tuple(d): self._map(d) for d in directions}

    def _map(self, d):
        a = np.cross(d, [0.3, 0.5, 0.8]); a /= np.linalg.norm(a)
        flat = np.stack([self.t @ a, self.t @ np.cross(d, a)], -1)
        low, high = flat.min(1) - 1e-9, flat.max(1) + 1e-9
        cell = (high - low).max()
        grid = {}
        for j in np.nonzero(self.n @ d > 0)[0]:
            grid.setdefault(tuple(np.floor(low[j] / cell).astype(int)), []).append(j)
        return low, high, cell, grid

    def of(self, i, d):
        low, high, cell, grid = self.maps[tuple(d)]
        x, y = np.floor(low[i] / cell).astype(int)
        # A box that meets this one begins at most one cell before it or, as this one is no larger than a cell, one after.
        j = np.array([j for u in (-1, 0, 1) for v in (-1, 0, 1) for j in grid.get((x + u, y + v), ())], int)
        j = j[((low[j] <= high[i]) & (low[i] <= high[j])).all(1)]
        # What lies behind the facet's plane hides nothing of it.
        return np.sort(j[((self.t[j] - self.t[i, 0]) @ self.n[i]).max(1) > 0])


def sums(peer, scene):
    """{masking: {material: G}} by the peer's exact_direct, told which occluders to look at and evaluating both maskings."""
    text = inspect.getsource(peer.exact_direct)

    def change(old, new):
        nonlocal text
        if text.count(old) != 1:
            sys.exit("exact_direct of the peer script is not the one that this script knows: no `%s`" % old.strip())
        text = text.replace(old, new)

    change("for j, (_, b) in enumerate(tri):", "for j, b in ((j, tri[j][1]) for j in near.of(i, d)):")
    change("    G = {m: 0.0 for m, _ in tri}\n", "    G = {k: {m: 0.0 for m, _ in tri} for k in MASKINGS}\n    near = Near(tri, nrm, (s, w))\n")
    lines = text.splitlines()
    first = next(k for k, line in enumerate(lines) if "f = 1 / math.pi if" in line)
    if "G[m] +=" not in lines[first + 1]:
        sys.exit("exact_direct of the peer script is not the one that this script knows: no sum after the reflection")
    space = " " * (len(lines[first]) - len(lines[first].lstrip()))
    lines[first:first + 2] = [space + "for k in MASKINGS:", space + "    globals()['SMITH'] = k", "    " + lines[first],
                              "    " + lines[first + 1].replace("G[m]", "G[k][m]")]
    # Among the peer's own names, so that its beckmann sees the masking.
    names, original = vars(peer), peer.exact_direct
    names.update(Near=Near, MASKINGS=MASKINGS)
    exec("\n".join(lines), names)
    changed, peer.exact_direct = peer.exact_direct, original
    return changed(scene)


def bin_means(peer, material):
    edges = np.linspace(peer.LMIN, peer.LMAX, 189)
    f = lambda lam: peer.solar_on(lam) * peer.reflectance(material, lam)
    return (f(edges[:-1]) + 4 * f((edges[:-1] + edges[1:]) / 2) + f(edges[1:])) / 6


def header(title, columns, made):
    lines = ["# %ECSV 1.0", "# ---", "# delimiter: ','", "# datatype:"]
    lines += ["# - {name: %s, %sdatatype: %s}" % (n, "unit: %s, " % u if u else "", t) for n, u, t in columns]
    lines += ["# meta: !!omap", '# - title: "%s"' % title, '# - source: "%s"' % made, '# - licence: "CC0-1.0"', "# schema: astropy-2.0"]
    return lines + [",".join(n for n, _, _ in columns)]


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    peer, folder = load(sys.argv[1]), sys.argv[2]
    sha = hashlib.sha256(open(sys.argv[1], "rb").read()).hexdigest()[:16]
    made = "benches/truths.py with mitsuba_scenes.py (sha256 %s...), numpy %s, %s: exact_direct, convex_lambert_truth" % (
        sha, np.__version__, datetime.date.today().isoformat())
    rows, spectra = [], {}
    for name in ("box_wing", "box_wing_diffuse", "corner", "dense_sphere", "dense_satellite"):
        scene = peer.SCENES[name]()
        if name == "dense_satellite":
            scene["shapes"] = [dict(shape, mesh=split(shape["mesh"])) for shape in scene["shapes"]]
        if name == "dense_sphere":
            both = {masking: {"unit": peer.convex_lambert_truth(scene)} for masking in MASKINGS}
        else:
            both = sums(peer, scene)
        rows += [(name, m, g, both["rational"][m], peer.grey(m)) for m, g in both["exact"].items()]
        spectra[name] = sum(g * bin_means(peer, m) for m, g in both["exact"].items())
        print(name, both, flush=True)
    os.makedirs(folder, exist_ok=True)
    number = "%.17g"
    with open(os.path.join(folder, "exact.ecsv"), "w") as out:
        columns = [("scene", "", "string"), ("material", "", "string"), ("weight_m2_sr", "m2 / sr", "float64"),
                   ("weight_rational_m2_sr", "m2 / sr", "float64"), ("grey_reflectance", "", "float64")]
        title = "Exact sums of singly scattered light of the bench scenes, for each material: Smith's masking in closed form, and Mitsuba's fit of it"
        out.write("\n".join(header(title, columns, made) + ["%s,%s,%s,%s,%s" % (s, m, *(number % v for v in r)) for s, m, *r in rows]) + "\n")
    with open(os.path.join(folder, "spectra.ecsv"), "w") as out:
        columns = [("from_nm", "nm", "float64"), ("to_nm", "nm", "float64")]
        columns += [(name, "W / (sr nm)", "float64") for name in spectra]
        edges = np.linspace(peer.LMIN, peer.LMAX, 189)
        title = "Spectral radiant intensities of the bench scenes, means over bins of 5 nm, under a black-body Sun of 5772 K"
        values = [[edges[k], edges[k + 1], *(s[k] for s in spectra.values())] for k in range(188)]
        out.write("\n".join(header(title, columns, made) + [",".join(number % v for v in r) for r in values]) + "\n")


if __name__ == "__main__":
    main()
