"""The wheel beside the program: the same numbers to the last bit; errors, Ctrl-C, threads, pickles (python/check runs this)."""

import json
import math
import os
import pathlib
import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import sunglint as sg

PROGRAM = os.environ.get("SUNGLINT", "sunglint")
HERE = pathlib.Path(__file__).parent
ROOT = HERE.parent.parent

def program(*arguments, cwd=None):
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def demo(tmp_path_factory):
    """The folder of the program's own demonstration: scenes, elements, calibrated curves."""
    folder = tmp_path_factory.mktemp("demo") / "demo"
    program("demo", "-o", folder, "-q")
    return folder


@pytest.fixture
def scene(demo):
    return demo / "pass.toml"


def same(mine, theirs, ignore=()):
    """Equal to the last bit, but for keys that are costs."""
    if isinstance(theirs, dict):
        assert set(mine) == set(theirs)
        for key in theirs:
            if key not in ignore:
                same(mine[key], theirs[key], ignore)
    elif isinstance(theirs, list):
        assert len(mine) == len(theirs)
        for a, b in zip(mine, theirs):
            same(a, b, ignore)
    else:
        assert mine == theirs, (mine, theirs)


COSTS = ("cost", "seconds", "cpu_s", "command", "provenance")


def directions(n, seed):
    rng = np.random.default_rng(seed)
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]


def test_light_is_the_programs(tmp_path):
    sun, observer = directions(40, 1), directions(40, 2)
    rows = ["sun_x,sun_y,sun_z,observer_x,observer_y,observer_z"]
    rows += [",".join(repr(float(v)) for v in [*a, *b]) for a, b in zip(sun, observer)]
    (tmp_path / "rows.csv").write_text("\n".join(rows) + "\n")
    lines = program("light", "box_wing", "--table", tmp_path / "rows.csv", "--wavelength-nm", "450,700", "--json")
    theirs = [json.loads(line) for line in lines.splitlines()]
    mine = sg.Body("box_wing").light(sun, observer, wavelength_nm=[450, 700])
    assert len(mine) == len(theirs) == 40
    for i, row in enumerate(theirs):
        for k in range(2):
            assert mine.per_irradiance_m2_per_sr[i, k] == row["light"][k]["per_irradiance_m2_per_sr"]
            assert mine.error_m2_per_sr[i, k] == row["light"][k]["error_m2_per_sr"]
        assert mine.phase_deg[i] == row["phase_deg"]
        assert mine.met[i] == row["met"]


def test_scenes_are_the_programs(scene):
    theirs = json.loads(program("simulate", scene, "--station", "ufo", "--json", "-q"))
    told = []
    result = sg.Scene(scene, station="ufo").simulate(progress=lambda *a: told.append(a))
    same(result.summary, theirs, COSTS)
    assert result.table.rows == len(result.table["time_utc"]) > 10
    assert result.table.times().dtype == "datetime64[ns]"
    assert told and told[-1][1] <= told[-1][2]
    theirs = json.loads(program("explain", scene, "--station", "ufo", "--json", "-q"))
    same(sg.Scene(scene, station="ufo").explain().summary, theirs, COSTS)
    # Another table, and back.
    frame = result.to_pandas()
    assert len(frame) == result.table.rows
    again = pickle.loads(pickle.dumps(result))
    assert again.to_json() == result.to_json() and again.text == result.text
    assert list(again.table) == list(result.table)
    assert "<svg" in again._repr_html_()


def synthetic(tmp_path, name="curve"):
    """A curve with a period of 7.3 s (synthetic)."""
    rng = np.random.default_rng(5)
    t = np.sort(rng.uniform(0, 240, 500))
    phase = 2 * np.pi * t / 7.3
    m = 6 + 0.4 * np.sin(phase) + 0.2 * np.sin(2 * phase + 1) + rng.normal(0, 0.02, t.size)
    start = np.datetime64("2026-01-01T20:00:00", "ns")
    times = [str(start + np.timedelta64(int(s * 1e9), "ns")) + "Z" for s in t]
    path = tmp_path / f"{name}.csv"
    with open(path, "w") as file:
        file.write("time_utc,magnitude,sigma_mag\n")
        file.writelines(f"{a},{float(b)!r},0.02\n" for a, b in zip(times, m))
    return path, times, m


def test_periods_are_the_programs_and_the_truth(tmp_path):
    path, times, m = synthetic(tmp_path)
    theirs = json.loads(program("analyse", "period", path, "--json", "-q"))
    mine = sg.period(path)
    same(mine.summary, theirs, COSTS)
    curve = sg.Curve.from_arrays(times, m, sigma_mag=0.02, target="made up")
    text = sg.period(curve).text
    assert "7.3" in text, text


def test_curves_of_others(tmp_path):
    path, times, m = synthetic(tmp_path)
    curve = sg.read_photometry(path)
    theirs = json.loads(program("import", path, "--json", "-q"))
    same(curve._result.summary, theirs, COSTS)
    # To the last bit, whatever the order of the rows.
    assert np.array_equal(np.sort(curve.table["magnitude"]), np.sort(m))
    assert not curve.is_relative
    from astropy.time import Time

    again = sg.Curve.from_arrays(Time(np.array([t.rstrip("Z") for t in times]), scale="utc"), m)
    assert np.array_equal(again.table["magnitude"], curve.table["magnitude"])


def test_comparisons_and_fits_are_the_programs(demo):
    curve, scene = demo / "sphere.ecsv", demo / "sphere.toml"
    theirs = json.loads(program("compare", curve, scene, "--station", "ufo", "--json", "-q"))
    mine = sg.compare(curve, sg.Scene(scene, station="ufo"))
    same(mine.summary, theirs, COSTS)
    arguments = ["--station", "ufo", "--free", "gain", "--json", "-q"]
    theirs = json.loads(program("fit", curve, scene, *arguments))
    fitted = sg.fit(sg.Scene(scene, station="ufo"), curve, free=["gain"])
    same(fitted.summary, theirs, COSTS)
    assert fitted.converged and len(fitted.scenes) == 1
    assert pickle.loads(pickle.dumps(fitted)).converged


def test_detect_is_the_programs(tmp_path):
    from astropy.io import fits

    rng = np.random.default_rng(3)
    image = rng.normal(500, 8, (200, 260))
    y, x = np.mgrid[0:200, 0:260]
    for k in range(12):
        px, py = rng.uniform(20, 240), rng.uniform(20, 180)
        image += 900 * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * 1.6**2))
    pixels = np.clip(np.round(image), 0, 65535).astype("u2")
    fits.PrimaryHDU(pixels).writeto(tmp_path / "frame.fits")
    theirs = json.loads(program("detect", tmp_path / "frame.fits", "--json", "-q"))["frames"][0]
    mine = sg.detect(pixels, saturation_adu=65535)
    assert len(mine.points) == len(theirs["points"]) >= 8
    same(mine.points, theirs["points"])
    same(mine.streaks, theirs["streaks"])


def test_a_brdf_keeps_helmholtz_and_its_albedo(tmp_path):
    """Truth: a Lambert surface has f = ρ/π; ∫ f cos over the hemisphere by 20,000 directions of our own is its albedo (1 %: their noise)."""
    (tmp_path / "m.toml").write_text('[[material]]\nname = "white"\nmodel = "lambert"\nreflectance = 0.6\n')
    white = sg.Brdf(tmp_path / "m.toml")
    up = np.array([[0.0, 0.0, 1.0]])
    assert white.evaluate(550, up, up)[0] == pytest.approx(0.6 / math.pi, rel=1e-12)
    assert white.albedo(550) == pytest.approx(0.6, rel=1e-6)
    assert white.evaluate(550, up, -up)[0] == 0.0
    o = directions(40_000, 9)
    o = o[o[:, 2] > 0]
    i = np.repeat([[math.sin(0.5), 0.0, math.cos(0.5)]], len(o), axis=0)
    assert 2 * math.pi * np.mean(white.evaluate(550, i, o) * o[:, 2]) == pytest.approx(0.6, rel=0.02)


def test_errors_say_where(tmp_path):
    with pytest.raises(sg.Error, match="did you mean box_wing"):
        sg.Body("box_wings")
    with pytest.raises(sg.Error, match=r"shape \[2, 2\]"):
        sg.Body("box_wing").light(np.zeros((2, 2)), np.zeros((2, 2)))
    with pytest.raises(sg.Error, match="row 0"):
        sg.Body("box_wing").light([[math.nan, 0, 0]], [[0.0, 1, 0]])
    (tmp_path / "bad.toml").write_text("[target]\nmodel = 3\n")
    with pytest.raises(sg.Error) as caught:
        sg.Scene(tmp_path / "bad.toml", station="ufo").simulate()
    assert caught.value.file.endswith("bad.toml") and caught.value.line == 2
    with pytest.raises(sg.Error, match="no such file"):
        sg.Scene(tmp_path / "none.toml")
    with pytest.raises(sg.Error, match="utc, tai, tt or tdb"):
        sg.read_photometry(synthetic(tmp_path)[0], time_scale="gps")


def test_a_callback_that_fails_ends_the_work():
    n = 20_000

    def fails(stage, done, of):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        sg.Body("box_wing").light(directions(n, 1), directions(n, 2), progress=fails)


def test_ctrl_c_is_heard():
    code = (
        "import numpy as np, signal, sunglint as sg\n"
        # Whoever started the tests in the background may have it ignored, which is inherited.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "v = np.repeat([[1.0, 0, 0]], 3_000_000, axis=0); o = np.repeat([[0.0, 1, 0]], 3_000_000, axis=0)\n"
        "print('ready', flush=True)\n"
        "try:\n    sg.Body('box_wing').light(v, o, wavelength_nm=list(range(400, 500)))\n"
        "except KeyboardInterrupt:\n    print('heard', flush=True)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "ready\n"
    time.sleep(0.4)
    start = time.monotonic()
    child.send_signal(signal.SIGINT)
    try:
        heard, _ = child.communicate(timeout=60)
    finally:
        child.kill()
    assert heard == "heard\n"
    assert time.monotonic() - start < 5


def forked(queue):
    """What a call says in a forked process."""
    try:
        sg.Body("box_wing").light([[1.0, 0, 0]], [[0, 1.0, 0]])
        queue.put("no error")
    except sg.Error as error:
        queue.put(str(error))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_is_told_so():
    """A child has none of its parent's threads: a call would never end. Started anew it works."""
    import multiprocessing

    assert len(sg.Body("box_wing").light([[1.0, 0, 0]], [[0, 1.0, 0]])) == 1
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=forked, args=(queue,))
    child.start()
    try:
        assert "use the start method spawn or forkserver" in queue.get(timeout=60)
        child.join(60)
        assert child.exitcode == 0
    finally:
        child.kill()


def test_results_that_do_not_fit_are_a_memory_error():
    """A broadcast array of 10^15 rows has 24 bytes."""
    many = np.broadcast_to(np.array([1.0, 0.0, 0.0]), (10**15, 3))
    for call in (
        lambda: sg._core.Body("lambert_sphere").light(many, many, [550.0]),
        lambda: sg._core.Body("lambert_sphere").engine([550.0]).light(many, many),
    ):
        with pytest.raises(MemoryError, match="no memory for the results of 1000000000000000 geometries"):
            call()


def test_the_interpreter_goes_on_beside_long_work():
    ticks = []
    stop = threading.Event()

    def count():
        while not stop.is_set():
            ticks.append(1)
            time.sleep(0.005)

    thread = threading.Thread(target=count)
    thread.start()
    n = 1_000
    begun = len(ticks)
    sg.Body("box_wing").light(directions(n, 1), directions(n, 2))
    ended = len(ticks)
    stop.set()
    thread.join()
    assert ended > begun


def test_studies_are_the_programs(tmp_path, demo):
    """The same bytes from Python in parts, and from the program; read by pyarrow. Truth: a sphere k times as large is 5 lg k mag brighter, to rounding (1e-9)."""
    import pandas

    text = (demo / "sphere.toml").read_text().replace('"satellites.tle"', json.dumps(str(demo / "satellites.tle")))
    (tmp_path / "sphere.toml").write_text(text)
    study = tmp_path / "spheres.toml"
    study.write_text(
        '[study]\nscene = "sphere.toml"\nkeep = ["summary", "samples"]\ntasks_a_shard = 1\n'
        '[[parameter]]\nkey = "target.sphere.radius_m"\nvalues = [0.5, 1.0, 2.0]\n'
    )
    heard = []
    mine = sg.study(study, tmp_path / "mine", part=(2, 2), progress=lambda stage, done, of: heard.append(of))
    assert mine.report["missing"] == 0 and mine.report["shards"] == 1 and mine.report["part"] == "2/2" and heard[-1] == 1
    mine = sg.study(study, tmp_path / "mine")
    assert mine.report["missing"] == 0 and mine.report["tasks"] == 3
    program("study", study, "-o", tmp_path / "theirs", "-q")
    files = sorted(p.relative_to(tmp_path / "theirs") for p in (tmp_path / "theirs").rglob("*.parquet"))
    assert len(files) == 6
    for file in files:
        assert (tmp_path / "mine" / file).read_bytes() == (tmp_path / "theirs" / file).read_bytes()
    table = mine.summary()
    radius, mag = table["target.sphere.radius_m"].to_numpy(), table["brightest_v_mag"].to_numpy()
    assert np.allclose(mag[1] - mag, 5 * np.log10(radius / radius[1]), rtol=0, atol=1e-9)
    samples = mine.samples()
    assert len(samples) == table["samples"].sum()
    assert isinstance(samples["time_utc"].dtype, pandas.DatetimeTZDtype)
    with pytest.raises(sg.Error, match="another study"):
        study.write_text(study.read_text().replace("2.0", "3.0"))
        sg.study(study, tmp_path / "mine")


def test_the_usual_station_is_the_programs(tmp_path, demo, monkeypatch):
    """A scene that names no station: the environment's, else the folder's station.toml, as for the program; else an error."""
    import tomllib

    text = (demo / "sphere.toml").read_text().replace('"satellites.tle"', json.dumps(str(demo / "satellites.tle")))
    lines, in_station = [], False
    for line in text.splitlines():
        in_station = line.strip() == "[station]" if line.startswith("[") else in_station
        if not in_station and not line.startswith("station"):
            lines.append(line)
    assert "station" not in tomllib.loads("\n".join(lines))
    bare = tmp_path / "bare.toml"
    bare.write_text("\n".join(lines) + "\n")
    study = tmp_path / "study.toml"
    study.write_text('[study]\nscene = "bare.toml"\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SUNGLINT_STATION", raising=False)
    for call in (lambda: sg.Scene(bare).simulate(), lambda: sg.study(study, tmp_path / "none"), lambda: sg.fit(bare, demo / "sphere.ecsv", free=["gain"])):
        with pytest.raises(sg.Error, match="no station"):
            call()
    theirs = json.loads(program("simulate", bare, "--station", "ufo", "--json", "-q"))
    monkeypatch.setenv("SUNGLINT_STATION", "ufo")
    same(sg.Scene(bare).simulate().summary, theirs, COSTS)
    assert sg.study(study, tmp_path / "told").report["failed"] == 0
    monkeypatch.delenv("SUNGLINT_STATION")
    stations = ROOT / "radiometry" / "stations" / "ufo"
    for file in stations.rglob("*"):
        if file.is_file():
            there = tmp_path / file.relative_to(stations)
            there.parent.mkdir(parents=True, exist_ok=True)
            there.write_bytes(file.read_bytes())
    assert (tmp_path / "station.toml").exists()
    same(sg.Scene(bare).simulate().summary["channels"], theirs["channels"], COSTS)
    assert sg.study(study, tmp_path / "here").report["failed"] == 0


def test_stars_air_and_passes_are_the_programs(demo):
    when = "2020-11-18T18:00:00Z"
    theirs = json.loads(program("star", "Vega", "--at", when, "--station", "ufo", "--json", "-q"))
    same(sg.star("Vega", when, "ufo").summary, theirs, COSTS)
    theirs = json.loads(program("air", "-z", "0,60", "--from-nm", "400", "--to-nm", "700", "--step-nm", "100", "--points", "--water-mm", "7", "--station", "ufo", "--json", "-q"))
    mine = sg.air([0, 60], wavelength_nm=[400, 500, 600, 700], station="ufo", water_mm=7.0)
    same(mine.summary, theirs, COSTS)
    arguments = ["--tle", demo / "satellites.tle", "--from", "2020-11-18T16:00:00Z", "--to", "2020-11-18T17:00:00Z", "--station", "ufo", "--diameter-m", "2"]
    theirs = json.loads(program("passes", *arguments, "--json", "-q"))
    mine = sg.passes(demo / "satellites.tle", "2020-11-18T16:00:00Z", "ufo", end=np.datetime64("2020-11-18T17:00:00"), diameter_m=2)
    same(mine.summary, theirs, COSTS)
    assert mine.table.rows >= 2
    assert mine.encode("png")[:4] == b"\x89PNG" and "<svg" in mine._repr_html_()
    one = sg.passes(demo / "satellites.tle", "2020-11-18T16:00:00Z", "ufo", end="2020-11-18T17:00:00Z", norad_id=99004)
    assert set(one.table["norad_id"]) == {99004}
    with pytest.raises(sg.Error, match="99999"):
        sg.passes(demo / "satellites.tle", when, "ufo", norad_id=99999)


def test_a_session_becomes_the_programs_curves(demo, tmp_path):
    """The folder of `sunglint demo` holds what the program made of its own session: linear curves, kappa, calibrated curves."""
    session = sg.Session(demo / "session")
    assert session.check().is_whole
    reduced = session.reduce()
    for name in ("sphere_1", "box_wing_1"):
        theirs = sg.read_table(demo / "reduced" / f"{name}.ecsv")
        mine = reduced[name].table
        assert list(mine) == list(theirs)
        for column in theirs:
            assert np.array_equal(mine[column], theirs[column], equal_nan=mine[column].dtype.kind == "f"), column
    theirs = json.loads(program("calibrate", demo / "reduced", "--station", "ufo", "--json", "-q"))
    found = reduced.calibrate("ufo")
    # The inputs' paths differ, and nothing else.
    same(found.summary, theirs, (*COSTS, "inputs", "files", "file", "session"))
    curve = found.apply("sphere_1", magnitudes="V")
    theirs = sg.read_table(demo / "sphere.ecsv")
    for column in theirs:
        assert np.array_equal(curve.table[column], theirs[column], equal_nan=theirs[column].dtype.kind == "f"), column
    assert curve.photometry.table.rows > 10
    # A result stands for its file.
    same(sg.compare(curve, sg.Scene(demo / "sphere.toml"))["channels"], sg.compare(demo / "sphere.ecsv", demo / "sphere.toml")["channels"])
    again = pickle.loads(pickle.dumps(found))
    assert again.apply(reduced["sphere_1"]).text.splitlines()[0] == curve.text.splitlines()[0]
    with pytest.raises(sg.Error, match="no session"):
        sg.Session(tmp_path)


def test_the_demonstrations_night_is_the_programs(demo, tmp_path):
    night = sg.demo_night(tmp_path / "night")
    for name in ("night.toml", "virtual.toml", "sphere.toml", "pass.toml", "satellites.tle"):
        assert (tmp_path / "night" / name).read_bytes() == (demo / name).read_bytes()
    session = night.observe(tmp_path / "night" / "session")
    mine = (tmp_path / "night" / "session" / "virtual" / "truth.json").read_bytes()
    assert mine == (demo / "session" / "virtual" / "truth.json").read_bytes()
    assert session.check().is_whole
    with pytest.raises(FileExistsError):
        sg.demo_night(tmp_path / "night")
    (tmp_path / "real.toml").write_text((demo / "devices.toml").read_text())
    with pytest.raises(sg.Error):
        sg.Night(tmp_path / "real.toml").observe(tmp_path / "none")


def test_readings_are_the_programs(demo, tmp_path):
    path, _, _ = synthetic(tmp_path)
    theirs = json.loads(program("analyse", "fold", path, "--period", "7.3", "--json", "-q"))
    same(sg.fold(path, period_s=7.3).summary, theirs, COSTS)
    theirs = json.loads(program("analyse", "map", demo / "pass.toml", "--step-deg", "20", "--json", "-q"))
    same(sg.body_map(demo / "pass.toml", step_deg=20).summary, theirs, COSTS)
    theirs = json.loads(program("analyse", "unmix", demo / "sphere.ecsv", "--endmembers", "white,solar_cell", "--pass", demo / "sphere.toml", "--json", "-q"))
    same(sg.unmix(demo / "sphere.ecsv", ["white", "solar_cell"], scene=demo / "sphere.toml").summary, theirs, COSTS)
    with pytest.raises(sg.Error, match="air, range or phase"):
        sg.fold(path, period_s=7.3, keep=["nothing"])


def test_material_fits_are_the_programs(tmp_path):
    """A Lambert surface with 1 % of noise (synthetic), which is its own truth: ρ = 0.6 within the noise of the mean of 80 samples (0.1 %, 5 σ)."""
    rng = np.random.default_rng(6)
    rows = ["theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_per_sr"]
    for incidence in (5, 30, 50, 70):
        rows += [f"{incidence},0,{abs(o)},{180 if o > 0 else 0},{0.6 / math.pi * rng.normal(1, 0.01):.8g}" for o in range(-76, 80, 8)]
    table = tmp_path / "samples.csv"
    table.write_text("\n".join(rows) + "\n")
    theirs = json.loads(program("brdf", "fit", table, "--wavelength-nm", "550", "--law", "lambert", "--json", "-q"))
    mine = sg.fit_material(table, wavelength_nm=550, laws="lambert")
    same(mine.summary, theirs, COSTS)
    assert mine.brdf().albedo(550) == pytest.approx(0.6, rel=0.005)
    shown = mine.brdf().show()
    assert shown.table.rows > 0 and "<pre>" in shown._repr_html_()
    # Without a law: a composite.
    theirs = json.loads(program("brdf", "fit", table, "--wavelength-nm", "550", "--json", "-q"))
    same(sg.fit_material(table, wavelength_nm=550).summary, theirs, COSTS)


def test_microfacets_are_the_programs(tmp_path):
    """A GGX surface in closed form (Walter et al. 2007, equations 33 and 34; alpha 0.1, F0 0.9; synthetic), which is its own truth: F0 to 3e-3."""
    rows = ["# %ECSV 1.0", "# ---", "# datatype:"]
    rows += [f"# - {{name: {name}, datatype: float64, unit: {unit}}}" for name, unit in (("angle_deg", "deg"), ("f_per_sr", "1 / sr"), ("sigma_f_per_sr", "1 / sr"))]
    rows += ["# meta: {kind: retro_reflection, wavelength_nm: 632.8, cone_half_angle_deg: 0.5, scale_sigma: 0.02}", "angle_deg f_per_sr sigma_f_per_sr"]
    for angle in np.arange(-10.0, 65.5, 0.5):
        theta = math.radians(angle - 0.3)
        t2, cos2 = math.tan(theta) ** 2, math.cos(theta) ** 2
        d = 1 / (math.pi * (0.1 * cos2 * (1 + t2 / 0.01)) ** 2)
        f = 0.9 * d * 2 / (1 + math.sqrt(1 + 0.01 * t2)) / (4 * cos2)
        rows.append(f"{angle} {f!r} {0.01 * f!r}")
    table = tmp_path / "retro.ecsv"
    table.write_text("\n".join(rows) + "\n")
    theirs = json.loads(program("brdf", "ndf", table, "--resamplings", "40", "--json", "-q"))
    mine = sg.ndf(table, resamplings=40)
    same(mine.summary, theirs, COSTS)
    assert mine["f0"] == pytest.approx(0.9, rel=3e-3)


def test_attitudes_are_the_programs(tmp_path):
    """The spin of docs/reading-attitude.md, axis and period known: the phase that the light was made with, 40 degrees, to 1 degree (no noise, tolerance 1 %)."""
    page = (ROOT / "docs" / "reading-attitude.md").read_text()
    scene = next(b for b in page.split("```toml\n")[1:] if "axis_body" in b.split("```")[0]).split("```")[0]
    (tmp_path / "pass.toml").write_text(scene)
    program("simulate", "pass.toml", "-o", "m.ecsv", "-q", cwd=tmp_path)
    asked = ["analyse", "attitude", tmp_path / "m.ecsv", tmp_path / "pass.toml", "--known", "axis,period", "--channel", "g", "--json", "-q"]
    theirs = json.loads(program(*asked))
    mine = sg.attitude(tmp_path / "pass.toml", tmp_path / "m.ecsv", known=["axis", "period"], channels=["g"])
    same(mine.summary, theirs, COSTS)
    assert mine["minima"][0]["phase_deg"] == pytest.approx(40, abs=1)


def test_archives_are_the_programs_and_what_the_files_say(demo, tmp_path):
    """Truth of what is found: the curves read by astropy."""
    from astropy.table import Table as Read

    theirs = json.loads(program("archive", demo, "--index", tmp_path / "index", "--kind", "calibrated", "--json", "-q"))
    found = sg.archive(demo, kind="calibrated", index=tmp_path / "index")
    same(found.summary["passes"], theirs["passes"])
    assert theirs["index"]["read"] > 0 and found["index"]["read"] == 0
    assert {pathlib.Path(p).name for p in found.paths} >= {"sphere.ecsv"}
    for row in found["passes"]:
        read = Read.read(demo / row["file"])
        assert read.meta["quantity"] == "calibrated"
        good = np.isfinite(read[row["channel"] + "_rate_hz"])
        assert good.sum() == row["samples"]
        assert float(read[row["channel"] + "_rate_hz"][good].max()) == row["brightest"]
        times = np.array([t.rstrip("Z") for t in read["time_utc"][good]], dtype="datetime64[ns]")
        for told, truth in ((row["from_utc"], times.min()), (row["to_utc"], times.max())):
            # To the millisecond that is told.
            assert abs(np.datetime64(told.rstrip("Z"), "ns") - truth) <= np.timedelta64(500_001, "ns")
        assert [float(read["phase_deg"][good].min()), float(read["phase_deg"][good].max())] == row["phase_deg"]
    # The curve of one of them stands where a file of one does.
    one = next(p for p in found["passes"] if p["file"].endswith("sphere.ecsv"))
    asked = sg.archive(demo, object=one["target"], kind="calibrated", channel=one["channel"], index=tmp_path / "index")
    curve = asked.curve()
    assert curve.table.rows > 10 and set(curve.table) >= {"time_utc", one["channel"] + "_rate_hz"}
    below = sg.archive(demo, kind="calibrated", phase_below_deg=0.0, index=tmp_path / "index")
    assert not below["passes"] and not below.paths
    assert pickle.loads(pickle.dumps(found)).paths == found.paths
    with pytest.raises(sg.Error, match="no such folder"):
        sg.archive(tmp_path / "nowhere")
    for angle in (math.nan, 400.0):
        with pytest.raises(sg.Error, match="phase_below_deg is"):
            sg.archive(demo, phase_below_deg=angle, index=tmp_path / "index")
    with pytest.raises(sg.Error, match="kind"):
        sg.archive(demo, kind="nothing", index=tmp_path / "index")


def test_the_kept_engine_is_the_bodys_light():
    """Both state their error; they may differ by no more than the sum of it. Threads: the same bits from one and from four."""
    from concurrent.futures import ThreadPoolExecutor

    body = sg.Body("box_wing")
    sun, observer = directions(80, 1), directions(80, 2)
    engine = body.engine(wavelength_nm=[450, 700])
    value, error = engine(sun, observer)
    anew = body.light(sun, observer, wavelength_nm=[450, 700])
    assert value.shape == (80, 2)
    # What is left out beside the tolerance (1e-3 of the light) differs between the two.
    allowed = error + anew.error_m2_per_sr + 2e-3 * anew.per_irradiance_m2_per_sr
    assert np.all(np.abs(value - anew.per_irradiance_m2_per_sr) <= allowed + 1e-15)
    with ThreadPoolExecutor(4) as pool:
        parts = list(pool.map(lambda k: engine(sun[k::4], observer[k::4])[0], range(4)))
    for k in range(4):
        assert np.array_equal(parts[k], value[k::4])
    one, _ = engine(sun[:1], observer[:1])
    assert np.array_equal(one, value[:1])
    # Kept work space: single calls in any order, from many threads, give the same bits.
    order = np.random.default_rng(3).permutation(np.repeat(np.arange(80), 2))
    with ThreadPoolExecutor(4) as pool:
        singles = list(pool.map(lambda k: engine(sun[k : k + 1], observer[k : k + 1]), order))
    for k, (single, doubt) in zip(order, singles):
        assert np.array_equal(single[0], value[k]) and np.array_equal(doubt[0], error[k])
    # Arrays that are no plain rows in memory are read as what they are.
    turned = np.asfortranarray(sun), np.asfortranarray(observer)
    assert np.array_equal(engine(*turned)[0], value)
    assert np.array_equal(body.light(*turned, wavelength_nm=[450, 700]).per_irradiance_m2_per_sr, anew.per_irradiance_m2_per_sr)
    with pytest.raises(sg.Error, match="wavelength_nm is empty"):
        body.light(sun, observer, wavelength_nm=[])
    # Lists and single vectors are converted.
    assert np.array_equal(engine([list(sun[0])], observer[0])[0], value[:1])
    assert np.array_equal(pickle.loads(pickle.dumps(engine))(sun, observer)[0], value)
    with pytest.raises(sg.Error, match=r"observer has the shape \[3, 3\]"):
        engine(sun[:2], observer[:3])
    with pytest.raises(sg.Error, match="row 1"):
        engine(np.array([[1.0, 0, 0], [math.nan, 0, 0]]), observer[:2])
    with pytest.raises(sg.Error, match="nearer than"):
        body.engine(range_m=1e6)(sun[:1], observer[:1], np.array([1e5]))


def test_curves_and_bodies_travel(tmp_path):
    path, _, m = synthetic(tmp_path)
    curve = sg.read_photometry(path)
    again = pickle.loads(pickle.dumps(curve))
    assert np.array_equal(again.table["magnitude"], curve.table["magnitude"]) and again.path != curve.path
    assert "<pre>" in curve._repr_html_()
    body = pickle.loads(pickle.dumps(sg.Body("box_wing")))
    assert body.materials == sg.Body("box_wing").materials


def test_importing_takes_nothing_but_numpy():
    code = "import sys, sunglint; print([m for m in ('pandas', 'astropy', 'matplotlib') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"


def test_the_guides_examples_run(tmp_path, scene):
    """The blocks of docs/python.md, one after the other, where the demonstration's files lie."""
    page = (ROOT / "docs" / "python.md").read_text()
    blocks = [b.split("```", 1)[0] for b in page.split("```python\n")[1:]]
    assert blocks
    code = "import matplotlib; matplotlib.use('Agg')\n" + "\n".join(blocks)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=scene.parent)
    assert done.returncode == 0, done.stderr
