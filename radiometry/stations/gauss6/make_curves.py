#!/usr/bin/env python3
"""Makes the curves of the built-in station `gauss6`: six Gaussian bands of 26 nm standard deviation, evenly spaced from 531 to 1069 nm.

The first and the last are named in the thesis (G-531/26 and G-1069/26, figure G.5), the four between are evenly spaced; the peak is ours. Run in this folder; needs only Python.
"""
import math

SIGMA_NM, PEAK, CUT, STEP_NM = 26.0, 0.5, 5, 2
for k in range(6):
    centre = 531 + (1069 - 531) * k / 5
    name = f"g{centre:.0f}"
    with open(f"{name}.csv", "w", encoding="utf8") as f:
        f.write(f"# Gaussian band of {SIGMA_NM:.0f} nm standard deviation about {centre:.1f} nm, cut at {CUT} of them. Synthetic.\n# Made by make_curves.py.\nwavelength_nm,efficiency\n")
        low = int(centre - CUT * SIGMA_NM)
        for nm in range(low, int(centre + CUT * SIGMA_NM) + 1, STEP_NM):
            f.write(f"{nm},{PEAK * math.exp(-0.5 * ((nm - centre) / SIGMA_NM) ** 2):.6f}\n")
