#!/usr/bin/env python3
"""Makes the curves of the built-in station `ufo`: parametric shapes pinned to published peaks, NOT measured.

Silicon detectors: eta = p (1-R) exp(-a d1) (1 - exp(-a d2)), a = 4 pi k / lambda, R the normal reflectance, n and k of silicon from
Schinke et al. 2015 (../../data/refractive_indices.ecsv); d1 (dead layer) and d2 (depletion depth) put the peak where it is published,
p makes it as high. The coated sensors' R is taken as 0. Run in this folder; needs only Python.
"""
import csv, math

rows = [r for r in csv.DictReader(l for l in open("../../data/refractive_indices.ecsv", encoding="utf8") if not l.startswith("#"))]
tables = {}
for r in rows:
    tables.setdefault(r["material"], []).append((float(r["wavelength_nm"]), float(r["n"]), float(r["k"])))

def index(material, nm):
    t = tables[material]
    for (a, n0, k0), (b, n1, k1) in zip(t, t[1:]):
        if a <= nm <= b:
            f = (nm - a) / (b - a)
            return n0 + f * (n1 - n0), k0 + f * (k1 - k0)
    raise ValueError((material, nm))

def silicon(nm, d1_um, d2_um):
    _, k = index("silicon", nm)
    a = 4 * math.pi * k / (nm * 1e-3)
    return math.exp(-a * d1_um) * (1 - math.exp(-a * d2_um))

def logistic(x):
    return 1 / (1 + math.exp(-x))

def mirror(nm):
    n, k = index("aluminium", nm)
    return ((n - 1) ** 2 + k * k) / ((n + 1) ** 2 + k * k)

def write(name, column, lo, hi, peak_nm, peak, shape, notes, step=5):
    nm = list(range(lo, hi + 1, step))
    raw = [shape(x) for x in nm]
    at_peak = max(raw) if peak_nm is None else shape(peak_nm)
    scale = peak / at_peak if peak else 1
    top = nm[raw.index(max(raw))]
    with open(name, "w", encoding="utf8") as f:
        for note in notes:
            f.write(f"# {note}\n")
        f.write(f"wavelength_nm,{column}\n")
        for x, v in zip(nm, raw):
            f.write(f"{x},{max(0.0, v * scale):.5f}\n")
    print(f"{name}: highest at {top} nm, {max(raw) * scale:.4f}")

approximate = "Approximate, not measured: a parametric shape pinned to the published peak."
made = "Made by make_curves.py."

def best(lo, hi, peak_nm, d2s, d1s):
    """The layer depths whose curve peaks nearest to peak_nm."""
    choice = None
    for d2 in d2s:
        for d1 in d1s:
            values = [(silicon(x, d1, d2), x) for x in range(lo, hi + 1, 5)]
            miss = abs(max(values)[1] - peak_nm)
            if choice is None or miss < choice[0]:
                choice = (miss, d1, d2)
    return choice[1:]

def edges(nm, lo, hi, lo_width=8, hi_width=8):
    # 0 at the ends of the published range, 1 well inside.
    return max(0.0, math.tanh((nm - lo) / lo_width)) * max(0.0, math.tanh((hi - nm) / hi_width))

# Single-photon counters, thesis table B.2.
d1, d2 = best(350, 1100, 650, [15, 18, 20, 22, 25, 28, 30], [0.05 * i for i in range(1, 30)])
write("efficiency_spcm.csv", "efficiency", 350, 1100, 650, 0.70, lambda x: silicon(x, d1, d2) * edges(x, 350, 1100),
      [f"Photon detection efficiency, Excelitas SPCM-AQRH-10: 70 % at 650 nm, 350-1100 nm (thesis table B.2).", approximate,
       f"Silicon with a dead layer of {d1:.2f} um and a depletion depth of {d2:g} um. {made}"])
d1, d2 = best(320, 900, 420, [0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5], [0.005 * i for i in range(0, 20)])
write("efficiency_mppc.csv", "efficiency", 320, 900, 420, 0.50, lambda x: silicon(x, d1, d2) * edges(x, 320, 900),
      [f"Photon detection efficiency, Hamamatsu C11208-03: 50 % at 420 nm, 320-900 nm (thesis table B.2).", approximate,
       f"Silicon with a dead layer of {d1:.2f} um and a depletion depth of {d2:g} um. {made}"])
# InGaAs(P)/InP: the InP substrate absorbs to about 920 nm, the absorber's gap ends the response near 1150-1240 nm.
write("efficiency_id400.csv", "efficiency", 880, 1240, 950, 0.35,
      lambda x: logistic((x - 915) / 8) * math.exp(-max(0.0, x - 950) / 330) * logistic((1150 - x) / 22) * edges(x, 880, 1240, 20, 20),
      ["Photon detection efficiency, IDQ ID400: 35 % at 950 nm, 880-1240 nm (thesis table B.2).", approximate,
       f"Smooth edges where the InP window opens and the InGaAsP absorber ends. {made}"])

# Camera, thesis table B.1: silicon under Bayer dyes; the dye a bell with its published centre, 0 at the published ends.
def dye(centre, left, right):
    return lambda x: math.exp(-(((x - centre) / (left if x < centre else right)) ** 2))
for plane, lo, hi, centre, peak, bell in [("b", 350, 660, 450, 0.50, dye(450, 55, 45)), ("g", 400, 650, 520, 0.56, dye(520, 45, 50)),
                                          ("r", 400, 700, 600, 0.56, dye(600, 28, 75))]:
    leak = 0.02  # dyes leak a little over the whole published range
    write(f"efficiency_{plane}.csv", "efficiency", lo, hi, centre, peak, lambda x, b=bell, l=lo, h=hi: (b(x) + leak) / (1 + leak) * edges(x, l, h, 15, 15),
          [f"Quantum efficiency of the {plane.upper()} pixels, Atik 414ex (Sony ICX825): {100 * peak:.0f} % at {centre} nm, {lo}-{hi} nm (thesis table B.1).",
           approximate, f"A bell over a leak of 2 %, 0 at the ends of the range. {made}"])

# Optics: two aluminium mirrors, corrector, beam splitter (30 % to the camera, 70 % to the fibre), fibre or relay, dichroics of the array.
def optics(name, share, band, lo, hi, text):
    write(name, "transmission", lo, hi, None, None, lambda x: mirror(x) ** 2 * 0.96 * share * band(x),
          [f"Transmission of the optics: two aluminium mirrors (Rakic 1995), corrector 0.96, {text}.",
           "Approximate, not measured: the makers' curves are not public. Losses in the fibre and at the sensor are left to the star calibration.", made])
optics("optics_camera.csv", 0.30, lambda x: 1.0, 300, 1100, "beam splitter to the camera 0.30")
optics("optics_mppc.csv", 0.70, lambda x: logistic((560 - x) / 6), 300, 950, "beam splitter to the fibre 0.70, dichroic below 560 nm (edge assumed)")
optics("optics_spcm.csv", 0.70, lambda x: logistic((x - 560) / 6) * logistic((880 - x) / 6), 300, 1150,
       "beam splitter to the fibre 0.70, dichroics 560-880 nm (edges assumed)")
optics("optics_id400.csv", 0.70, lambda x: logistic((x - 880) / 6), 800, 1240, "beam splitter to the fibre 0.70, dichroic above 880 nm (edge assumed)")
