"""Streaks by SEP and by a Hough transform: the peers of the search in `calibration::photometry::field`.

    streaks_sep.py SIDE

Reads frames of SIDE x SIDE from the standard input (float32, little-endian, row by row) and answers each with lines `sep X0 Y0 X1 Y1` and `hough X0 Y0 X1 Y1`, one a streak, and a line `end`.

SEP: sources above 1.5 standard deviations with an axis ratio above 2.5 and a length of 20 px; even light of length L has a standard deviation of L/sqrt(12) along it. Hough: pixels above 2.5 standard deviations, without those of
round sources, vote for 360 directions; a line counts where a stretch of 20 px and more has four standard deviations more votes than chance, and four lit pixels in ten of its length.
"""
import sys

import numpy as np
import sep

side = int(sys.argv[1])
angles = np.pi * np.arange(360) / 360
unit = np.stack([np.cos(angles), np.sin(angles)])
reach = int(np.ceil(np.hypot(side, side)))
# Pixels of the frame on each line, two wide.
rows, columns = np.mgrid[0:side, 0:side].reshape(2, -1)


def votes(x, y):
    count = np.empty((len(angles), 2 * reach + 1), np.int32)
    for k in range(len(angles)):
        rho = np.rint(x * unit[0, k] + y * unit[1, k]).astype(int) + reach
        count[k] = np.bincount(rho, minlength=2 * reach + 1)
    return count


whole = votes(columns, rows)


def hough(mask):
    found = []
    mask = mask.copy()
    for _ in range(5):
        y, x = np.nonzero(mask)
        density = len(x) / mask.size
        if len(x) < 10:
            break
        count = votes(x, y)
        excess = (count - density * whole) / np.sqrt(np.maximum(density * whole, 1.0))
        k, rho = np.unravel_index(np.argmax(excess), excess.shape)
        if excess[k, rho] < 4:
            break
        off = np.abs(x * unit[0, k] + y * unit[1, k] + reach - rho) <= 1.5
        along = np.sort(-x[off] * unit[1, k] + y[off] * unit[0, k])
        # The longest stretch without a gap of 6 px.
        parts = np.split(along, np.nonzero(np.diff(along) > 6)[0] + 1)
        best = max(parts, key=lambda p: p[-1] - p[0])
        a, b = best[0], best[-1]
        r = rho - reach
        if b - a >= 20 and len(best) >= 0.4 * (b - a):
            ends = [(r * unit[0, k] - t * unit[1, k], r * unit[1, k] + t * unit[0, k]) for t in (a, b)]
            found.append((*ends[0], *ends[1]))
        mask[y[off], x[off]] = False
    return found


data = sys.stdin.buffer
while True:
    raw = data.read(side * side * 4)
    if len(raw) < side * side * 4:
        break
    pixels = np.frombuffer(raw, "<f4").reshape(side, side).copy()
    background = sep.Background(pixels)
    pixels -= background.back()
    rms = background.globalrms
    sources, segments = sep.extract(pixels, 1.5, err=rms, deblend_cont=1.0, segmentation_map=True)
    ratio, length = sources["a"] / sources["b"], np.sqrt(12) * sources["a"]
    for s in sources[(ratio > 2.5) & (length >= 20)]:
        d = np.sqrt(3) * s["a"] * np.array([np.cos(s["theta"]), np.sin(s["theta"])])
        print("sep", s["x"] - d[0], s["y"] - d[1], s["x"] + d[0], s["y"] + d[1])
    round_ones = np.concatenate([[False], (ratio < 1.9) & (length < 40)])
    for line in hough((pixels > 2.5 * rms) & ~round_ones[segments]):
        print("hough", *line)
    print("end", flush=True)
