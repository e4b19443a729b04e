"""The inputs that the cases share, made once by the baseline's program in the folder that cases see as `in/`.

Each step is a command line of the program, or a function that gets the folder. Before the first step the folder holds all of inputs/, and the repository's
fixtures as fixtures/.
"""

import json
import math
import random
import shutil


def station(folder):
    """A station of six Gaussian bands (synthetic), and copies of the fixture's elements."""
    place = folder / "six_bands"
    place.mkdir()
    text = (
        'name = "six_bands"\n[site]\nlatitude_deg = 48.7826\nlongitude_deg = 9.1964\nheight_m = 400.0\n[telescope]\nprimary_diameter_m = 0.43\n'
        'obstruction_diameter_m = 0.0\nfocal_length_m = 2.9\nmount = "equatorial"\n[air]\nprofile = "midlatitude_winter"\n'
    )
    for centre in [531, 639, 746, 854, 961, 1069]:
        curve = "wavelength_nm,efficiency\n"
        for d in range(-130, 131, 5):
            curve += f"{centre + d},{0.5 * math.exp(-0.5 * (d / 26.0) ** 2):.6f}\n"
        (place / f"g{centre}.csv").write_text(curve)
        text += (
            f'[[channel]]\nname = "g{centre}"\nefficiency = "g{centre}.csv"\n[channel.counter]\ndead_time_model = "none"\n'
            "saturation_hz = 1e9\ndark_rate_hz = 0.0\n"
        )
    (place / "station.toml").write_text(text)


HEAD = """# %ECSV 1.0
# ---
# datatype:
# - {name: time_utc, datatype: string}
# - {name: exposure_s, unit: s, datatype: float64}
# - {name: spcm_rate_hz, unit: Hz, datatype: float64}
# - {name: spcm_sigma_hz, unit: Hz, datatype: float64}
# - {name: spcm_flags, datatype: int64}
# - {name: zenith_deg, unit: deg, datatype: float64}
# meta: {quantity: QUANTITY, flag_bits: {}}
# schema: astropy-2.0
time_utc exposure_s spcm_rate_hz spcm_sigma_hz spcm_flags zenith_deg
"""


def curves(folder):
    """Curves of made-up bodies (synthetic): two lobes a turn of 20 s; tracks of magnitudes as catalogues publish them."""

    def lobe(turn, at, width):
        return math.exp(width * (math.cos(2 * math.pi * (turn - at)) - 1.0))

    (folder / "curves").mkdir(exist_ok=True)
    text = ""
    for i in range(600):
        t = 0.25 + 0.5 * i
        ripple = (i * i * 0.61803398875) % 1.0 - 0.5
        rate = 1e4 * (1.0 + lobe(t / 20, 0.1, 8.0) + 0.5 * lobe(t / 20, 0.6, 15.0) + 0.05 * ripple)
        text += f"2008-09-21T18:{46 + int(t // 60):02}:{t % 60:06.3f} 0.1 {rate:.3f} 150 0 40\n"
    for quantity in ["linear", "predicted"]:
        (folder / "curves" / f"turning_{quantity}.ecsv").write_text(HEAD.replace("QUANTITY", quantity) + text)
    flat = "".join(f"2008-09-21T18:46:{i:02}.000 0.1 1000.0 0 0 40\n" for i in range(30))
    (folder / "curves" / "flat.ecsv").write_text(HEAD.replace("QUANTITY", "linear") + flat)
    chance = random.Random(7)
    text = "# synthetic\n# Date Time StdMag Mag Filter Penumbra Distance Phase Channel Track\n"
    columns = "time_utc,magnitude,range_km,phase_deg\n"
    for i in range(1200):
        t = 0.1 * i
        range_km = 900.0 + 300.0 * (t / 120.0) ** 2
        flux = (0.3 + lobe(t / 7.3, 0.16, 6.0) + 0.4 * lobe(t / 7.3, 0.64, 12.0)) / (range_km / 1000.0) ** 2
        magnitude = 7.0 - 2.5 * math.log10(flux) + 0.05 * chance.gauss(0, 1)
        when = f"16:{10 + int(t // 60):02}:{t % 60:09.6f}"
        text += f"2024-02-28 {when} {magnitude:.3f} {magnitude:.5f} Clear 0 {range_km:.3f} 60.000 7 1\n"
        columns += f"2024-02-28T{when}Z,{magnitude:.5f},{range_km:.3f},60\n"
    (folder / "curves" / "track.txt").write_text(text)
    (folder / "curves" / "track.csv").write_text(columns)
    columns = "time_utc,magnitude\n"
    for day, at in [("2024-02-28", 0.0), ("2024-04-29", 3.21)]:
        for i in range(600):
            t = 0.1 * i
            turn = (t + at) / 7.3
            magnitude = 7.0 - 2.5 * math.log10(0.3 + lobe(turn, 0.16, 6.0) + 0.4 * lobe(turn, 0.64, 12.0)) + 0.05 * chance.gauss(0, 1)
            columns += f"{day}T16:{10 + int(t // 60):02}:{t % 60:09.6f}Z,{magnitude:.5f}\n"
    (folder / "curves" / "tracks.csv").write_text(columns)
    rows = "time_utc,magnitude,sigma\n2020-11-18T16:00:00Z,4.5,0.1\n2020-11-18T16:39:20Z,,0.1\n"
    for i in range(60):
        rows += f"2020-11-18T16:{39 + (30 + 5 * i) // 60:02}:{(30 + 5 * i) % 60:02}Z,{3.9 + 0.02 * math.sin(i):.3f},0.05\n"
    (folder / "curves" / "magnitudes.csv").write_text(rows)
    rows = "time_utc,magnitude,range_km,phase_deg,sigma_mag\n"
    for i in range(60):
        rows += f"2020-11-18T16:{39 + (30 + 5 * i) // 60:02}:{(30 + 5 * i) % 60:02}Z,{3.9 + 0.02 * math.sin(i):.3f},{1200 + abs(i - 30) * 5},{90 - i / 2},0.05\n"
    (folder / "curves" / "ranged.csv").write_text(rows)


def states(folder):
    """States and attitudes of a body (synthetic) that no elements describe: a circle of 7,160 km."""
    states = "time_utc,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n"
    turns = "time_utc,q_w,q_x,q_y,q_z\n"
    # Perpendicular axes: the first goes up over the station in the middle of the window.
    up, along, a = (0.6096, -0.2385, 0.7560), (-0.7006, 0.2740, 0.6588), 7160.0
    rate = math.sqrt(398600.4418 / a**3)
    for i in range(-12, 72):
        t = 10.0 * i
        angle = rate * (t - 240.0)
        c, s = math.cos(angle), math.sin(angle)
        place = [a * (c * u + s * v) for u, v in zip(up, along)]
        speed = [a * rate * (c * v - s * u) for u, v in zip(up, along)]
        second = 16 * 3600 + 22 * 60 + int(t)
        when = f"2020-11-18T{second // 3600:02}:{second // 60 % 60:02}:{second % 60:02}Z"
        states += f"{when}," + ",".join(f"{x:.6f}" for x in place + speed) + "\n"
        half = math.pi * t / 120.0
        turns += f"{when},{math.cos(half):.9f},0,0,{math.sin(half):.9f}\n"
    (folder / "scenes" / "states.csv").write_text(states)
    (folder / "scenes" / "turns.csv").write_text(turns)


def spectra(folder):
    """A spectrometer's files of a made-up panel (synthetic): a lobe of microfacets over paint, two detectors, 104 directions."""
    place = folder / "lab"

    def unit(theta, phi):
        theta, phi = math.radians(theta), math.radians(phi)
        return [math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)]

    def panel(nm, at):
        i, o = unit(at[0], 0.0), unit(at[1], at[2])
        h = [a + b for a, b in zip(i, o)]
        cos2 = h[2] ** 2 / sum(v * v for v in h)
        a2 = 0.15**2
        d = a2 / (math.pi * (cos2 * (a2 - 1.0) + 1.0) ** 2)

        def g(z):
            return 2.0 / (1.0 + math.sqrt(1.0 + a2 * (1.0 / (z * z) - 1.0)))

        return 0.5 * d * g(i[2]) * g(o[2]) / (4.0 * i[2] * o[2]) + (0.1 + nm / 5000.0) / math.pi

    def lamp(nm):
        return 100.0 + 0.1 * nm

    def si(name, light):
        rows = "".join(f"{nm},{2.0 * light(nm) + 1.0:.9g}\n" for nm in range(400, 800, 2))
        (place / name).write_text("wavelength_nm,counts\n" + rows)

    def ingaas(name, light):
        first, last, n = 15000.0, 10000.0, 501
        text = f"##TITLE=x\n##JCAMP-DX=4.24\n##XUNITS=1/CM\n##YUNITS=ARBITRARY\n##FIRSTX={first}\n##LASTX={last}\n##NPOINTS={n}\n##XYDATA=(X++(Y..Y))\n"
        for k in range(n):
            x = first - 10.0 * k
            text += f"{x} {light(1e7 / x):.9g}\n"
        (place / name).write_text(text + "##END=\n")

    si("si_reference.csv", lambda nm: 0.95 * lamp(nm))
    si("si_dark.csv", lambda nm: 0.0)
    ingaas("ingaas_reference.dx", lambda nm: 0.95 * lamp(nm))
    more = (place / "ingest_head.toml").read_text()
    for k in range(104):
        at = [
            [0.0, 20.0, 40.0, 60.0][k % 4],
            3.0 + 3.0 * ((k // 4) % 26),
            [180.0, 180.0, 150.0, 90.0, 0.0][(k // 7) % 5],
        ]

        def signal(nm, at=at):
            return 0.002 * math.cos(math.radians(at[1])) * panel(nm, at) * lamp(nm)

        name = "a" if k == 0 else f"d{k}"
        si(f"{name}_si.csv", signal)
        ingaas(f"{name}_ingaas.dx", lambda nm, signal=signal: 1.1 * signal(nm))
        if k:
            more += (
                f"[[direction]]\ntheta_i_deg = {at[0]}\nphi_i_deg = 0\ntheta_o_deg = {at[1]}\nphi_o_deg = {at[2]}\n"
                f'files = {{ si = "{name}_si.csv", ingaas = "{name}_ingaas.dx" }}\ndark = {{ si = "si_dark.csv" }}\n'
            )
    (place / "ingest.toml").write_text(more)


def anisotropic(folder):
    """Retro-reflection of a made-up brushed sample (synthetic) in six planes, with flags by name."""
    rows = "angle_deg,f_per_sr,sigma_f_per_sr,azimuth_deg,flags\n"
    for azimuth in range(0, 180, 30):
        phi = math.radians(azimuth)
        alpha = 1.0 / math.sqrt((math.cos(phi) / 0.1) ** 2 + (math.sin(phi) / 0.3) ** 2)
        for angle in range(-12, 67, 2):
            x = math.radians(angle - 0.4)
            f = 1.0 / (math.cos(x) ** 5 * (1.0 + (math.tan(x) / alpha) ** 2) ** 2)
            flag = "over_range" if angle == 40 and azimuth == 60 else ""
            rows += f"{angle},{f:.8g},{0.01 * f:.8g},{azimuth},{flag}\n"
    (folder / "lab" / "anisotropic.csv").write_text(rows)


def second_night(folder):
    """The stars of the fixture's night once more, a day later (synthetic), a tenth fainter."""
    source, target = folder / "linear", folder / "linear_next"
    target.mkdir()
    for path in source.glob("*.ecsv"):
        if path.name == "summary.ecsv":
            continue
        target.joinpath(path.name).write_text(path.read_text().replace("2020-11-18T", "2020-11-19T"))


def hazy(folder):
    """The stars of the demonstration behind a haze that no station file names (synthetic): fainter by the airmass."""
    target = folder / "hazy"
    target.mkdir()
    for path in (folder / "demo" / "reduced").glob("*.ecsv"):
        lines, names = [], None
        for line in path.read_text().splitlines():
            cells = line.split(",")
            if not line.startswith("#") and names is None:
                names = cells
            elif names and "zenith_deg" in names and len(cells) == len(names):
                zenith = float(cells[names.index("zenith_deg")])
                dimmed = math.exp(-0.15 / math.cos(math.radians(zenith)))
                for i, name in enumerate(names):
                    if name.endswith("_rate_hz") and cells[i] not in ("", "nan", "NaN"):
                        cells[i] = repr(float(cells[i]) * dimmed)
            lines.append(",".join(cells))
        if path.name != "summary.ecsv":
            (target / path.name).write_text("\n".join(lines) + "\n")


def turned(folder):
    """The V magnitudes of the simulated turning body, as a table that somebody may have measured."""
    target = folder / "curves" / "turned"
    target.mkdir()
    rows, names = "time_utc,magnitude,range_km,phase_deg\n", None
    for line in (folder / "sims" / "turning_geometry.ecsv").read_text().splitlines():
        cells = line.split(",")
        if line.startswith("#"):
            continue
        if names is None:
            names = cells
            continue
        row = dict(zip(names, cells))
        if float(row["v_mag"]) < 30:
            rows += f"{row['time_utc']},{float(row['v_mag']):.4f},{float(row['range_m']) / 1e3:.3f},{row['phase_deg']}\n"
    (target / "magnitudes.csv").write_text(rows)


def demonstration(folder):
    """What the demonstration leaves, without what only costs room."""
    for name in ["compared", "fitted"]:
        shutil.rmtree(folder / "demo" / name)


def cut_session(folder):
    """A session that was cut: half a last line, a frame that lacks and one that is none."""
    target = folder / "cut_session"
    shutil.copytree(folder / "fixtures" / "nights" / "2020-11-18_synthetic", target)
    counts = target / "counts" / "tagger.ecsv"
    text = counts.read_text()
    counts.write_text(text[: len(text) // 2])
    frames = sorted((target / "frames" / "cam" / "16").iterdir())
    frames[3].unlink()
    frames[5].write_bytes(b"no frame")


STEPS = [
    station,
    curves,
    states,
    spectra,
    anisotropic,
    "demo -o demo -q",
    demonstration,
    hazy,
    "reduce fixtures/nights/2020-11-18_synthetic -o linear/ -q",
    second_night,
    cut_session,
    "calibrate demo/reduced --station ufo -o kappa.ecsv -q",
    "calibrate linear linear_next --station ufo -o kappa_two.ecsv -q",
    "simulate scenes/sphere_pass.toml -o sims/ -q",
    "simulate scenes/spinning.toml -o sims/ -q",
    "simulate scenes/turning.toml --step-s 20 -o sims/ -q",
    turned,
    "simulate scenes/fit_sphere.toml -o sims/fit_sphere.ecsv -q",
    "simulate scenes/corner.toml -o sims/corner.ecsv -q",
    "simulate demo/pass.toml --station six_bands --tolerance 1% --step-s 4 -o sims/six/ -q",
    "brdf retro lab/run.toml -o lab/retro/ --yes -q",
    "brdf ndf lab/retro/retro.ecsv --resamplings 5 -o lab/ndf/ -q",
    "brdf ndf lab/anisotropic.csv --resamplings 2 -o lab/anisotropic/ -q",
    "brdf plan lab/ndf/ndf.ecsv --side 9 -o lab/plan/ -q",
    "brdf ingest lab/ingest.toml -o lab/samples/ -q",
    "brdf assemble lab/samples/samples.ecsv lab/ndf/ndf.ecsv -o lab/panel.bsdf --side 9 --theta-i 6 --normals 32 -q",
    "brdf fit lab/samples/samples.ecsv --wavelength-nm 550 -o lab/law/ -q",
    "observe night/short.toml -o night/short -q",
    "observe night/live.toml -o night/live -q",
]
