"""Apertures by photutils, as truths: makes frames and measures them, or measures frames that are there.

    apertures.py make FOLDER       writes frames.fits and apertures.json
    apertures.py measure FOLDER    reads frames.fits and the apertures of apertures.json, prints the JSON anew
    apertures.py time FRAME        times photutils and SEP on the first image: an aperture of 8 px, an annulus of 12 to 20 px
    apertures.py search FRAME      times the search of both for all sources of the first image: background, filter of 4 px, threshold of 6 sigma
"""

import json
import sys
import timeit

import numpy as np
from astropy.io import fits
from astropy.stats import SigmaClip


def point(shape, x, y, flux, fwhm):
    from scipy.special import erf

    s = fwhm / 2.3548200450309493 * np.sqrt(2)
    edge = lambda n, c: 0.5 * np.diff(erf((np.arange(n + 1) - 0.5 - c) / s))
    return flux * np.outer(edge(shape[0], y), edge(shape[1], x))


def make(folder):
    rng = np.random.default_rng(20261121)
    frames, cases = [], []
    for i, (flux, sky, fwhm, read) in enumerate(
        [(3e5, 400.0, 4.0, 20.0), (4e5, 2500.0, 3.2, 5.0), (2e4, 150.0, 5.0, 3.0), (4e5, 900.0, 4.5, 8.0)]
    ):
        x, y = rng.uniform(28, 35, 2)
        light = sky + point((64, 64), x, y, flux, fwhm) + point((64, 64), x + 15, y + 4, flux / 30, fwhm)
        frame = rng.poisson(light) + rng.normal(0, read, light.shape) + 500
        frames.append(np.clip(np.round(frame), 0, 65535).astype(np.uint16))
        bad = [] if i < 2 else [[int(x) + 6, int(y) + 1], [int(x) + 14, int(y)], [int(x) - 3, int(y) + 5]]
        for radius in (8.0, 5.3):
            cases.append({"frame": i, "x": x, "y": y, "radius": radius, "annulus": [12.0, 20.0], "read": read, "bad": bad})
    fits.HDUList([fits.PrimaryHDU()] + [fits.ImageHDU(f) for f in frames]).writeto(folder + "/frames.fits", overwrite=True)
    with open(folder + "/apertures.json", "w") as file:
        file.write(measured(frames, cases))


def measured(frames, cases):
    import photutils
    from photutils.aperture import ApertureStats, CircularAnnulus, CircularAperture, aperture_photometry

    for case in cases:
        frame = frames[case["frame"]].astype(float)
        mask = np.zeros(frame.shape, bool)
        for column, row in case["bad"]:
            mask[row, column] = True
        place = (case["x"], case["y"])
        disc = CircularAperture(place, case["radius"])
        case["sum"] = float(aperture_photometry(frame, disc, mask=mask, method="exact")["aperture_sum"][0])
        annulus = ApertureStats(frame, CircularAnnulus(place, *case["annulus"]), mask=mask, sigma_clip=SigmaClip(3, maxiters=5), sum_method="center")
        case["median"] = float(annulus.median)
        area = ApertureStats(frame, disc, mask=mask, sum_method="exact").sum_aper_area.value
        case["area"] = float(area)
    return json.dumps({"photutils": photutils.__version__, "numpy": np.__version__, "cases": cases}, indent=1) + "\n"


def time(path):
    import photutils
    import sep
    from photutils.aperture import ApertureStats, CircularAnnulus, CircularAperture

    with fits.open(path) as file:
        frame = next(h.data for h in file if h.data is not None).astype(np.float64)
    x, y = frame.shape[1] / 2 + 0.3, frame.shape[0] / 2 - 0.2
    clip = SigmaClip(3, maxiters=5)

    def by_photutils(clip=clip):
        back = ApertureStats(frame, CircularAnnulus((x, y), 12, 20), sigma_clip=clip).median
        disc = CircularAperture((x, y), 8)
        return disc.do_photometry(frame, method="exact")[0][0] - back * disc.area

    def by_sep():
        return sep.sum_circle(frame, [x], [y], 8, bkgann=(12, 20), subpix=0)[0][0]

    for name, call in [
        (f"photutils {photutils.__version__}, clipped median", by_photutils),
        (f"photutils {photutils.__version__}, median", lambda: by_photutils(None)),
        (f"sep {sep.__version__}, mean", by_sep),
    ]:
        call()
        best = min(timeit.repeat(call, number=50, repeat=7)) / 50
        print(f"{name}: {best * 1e6:.1f} us, sum {call():.1f} ADU")


def search(path):
    import photutils
    import sep
    from photutils.background import Background2D, MedianBackground
    from photutils.detection import DAOStarFinder

    with fits.open(path) as file:
        frame = next(h.data for h in file if h.data is not None).astype(np.float32)
    y, x = np.mgrid[-7:8, -7:8]
    profile = np.exp(-0.5 * (x**2 + y**2) / (4.0 / 2.3548200450309493) ** 2).astype(np.float32)

    def by_sep():
        back = sep.Background(frame, bw=32, bh=32)
        return sep.extract(frame - back, 6.0, err=back.rms(), filter_kernel=profile, filter_type="matched")

    def by_photutils():
        back = Background2D(frame, 32, bkg_estimator=MedianBackground())
        return DAOStarFinder(threshold=6.0 * np.median(back.background_rms), fwhm=4.0)(frame - back.background)

    for name, call, runs in [(f"sep {sep.__version__}, background and extract", by_sep, 10), (f"photutils {photutils.__version__}, Background2D and DAOStarFinder", by_photutils, 1)]:
        found = call()
        best = min(timeit.repeat(call, number=1, repeat=runs))
        print(f"{name}: {best * 1e3:.1f} ms, {0 if found is None else len(found)} sources of {frame.shape[1]} x {frame.shape[0]}")


if __name__ == "__main__":
    verb, path = sys.argv[1:]
    if verb == "make":
        make(path)
    elif verb == "measure":
        with fits.open(path + "/frames.fits") as file, open(path + "/apertures.json") as cases:
            print(measured([h.data for h in file[1:]], json.load(cases)["cases"]))
    elif verb == "search":
        search(path)
    else:
        time(path)
