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
    with pytest.raises(sg.Error, match="utc, tai, tt, tdb or gps"):
        sg.read_photometry(synthetic(tmp_path)[0], time_scale="ut1")


def test_columns_are_read_as_the_program_reads_them(tmp_path):
    """Two objects of which only columns with unusual names tell (synthetic): one of 17 s, one of 29 s. Truth: what the program says of the same options, and the periods."""
    rows = ["# synthetic", "when,bright,doubt,object"]
    for i in range(600):
        noise = ((i * i * 0.6180339887498949) % 1 - 0.5) * 0.05
        t = i * 0.9 + 0.2 * ((i * 7919) % 13) / 13
        rows.append(f"{t:.4f},{8 + math.sin(2 * math.pi * t / 17) + noise:.4f},0.02,A")
        rows.append(f"{t:.4f},{9 + math.sin(2 * math.pi * t / 29) + noise:.4f},0.02,B")
    (tmp_path / "two.csv").write_text("\n".join(rows) + "\n")
    said = ["--time-column", "when", "--time-format", "s", "--magnitude-column", "bright", "--sigma-column", "doubt"]
    mine = dict(time_column="when", time_format="s", magnitude_column="bright", sigma_column="doubt")
    for name, period_s in (("A", 17), ("B", 29)):
        theirs = json.loads(program("analyse", "period", tmp_path / "two.csv", *said, "--object", name, "--json", "-q"))
        found = sg.period(tmp_path / "two.csv", object=name, **mine)
        same(found.summary, theirs, COSTS)
        assert abs(found["best"]["period_s"] / period_s - 1) < 0.01 or abs(found["best"]["period_s"] / period_s - 2) < 0.02
    with pytest.raises(sg.Error, match="2 objects"):
        sg.period(tmp_path / "two.csv", **mine)
    with pytest.raises(sg.Error, match="jd, mjd, unix, s, d or iso"):
        sg.period(tmp_path / "two.csv", object="A", **{**mine, "time_format": "days"})


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
    # A latency of half a second is taken off the frames, not off the bins.
    timing = tmp_path / "timing.toml"
    timing.write_text('format = 1\n[[camera]]\nname = "cam"\nclock = "driver"\nlatency_s = 0.5\nlatency_sigma_s = 0.01\n')
    moved, before = session.reduce(target="sphere", timing=timing)["sphere_1"].table, reduced["sphere_1"].table
    for channel, later_s in (("g", 0.5), ("spcm", 0.0)):
        times = [table["time_utc"][np.isfinite(table[f"{channel}_rate_hz"])] for table in (moved, before)]
        assert len(times[0]) == len(times[1]) > 10
        apart = (np.asarray(times[0], dtype="datetime64[ns]") - np.asarray(times[1], dtype="datetime64[ns]")) / np.timedelta64(1, "s")
        assert np.all(np.abs(apart - later_s) < 1e-6), channel
    with pytest.raises(sg.Error, match="no-such"):
        session.reduce(timing=tmp_path / "no-such.toml")
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


def test_the_example_of_a_night_to_a_fit_runs(tmp_path):
    """The block as people ask for it, word for word. Truth: the night's own scene, whose light its photons are."""
    night = sg.virtual_night(seed=1, folder=tmp_path / "other")
    (tmp_path / "pass.toml").write_text(pathlib.Path(night.folder, "pass.toml").read_text())
    block = (
        "import sunglint as sg\n"
        "night = sg.virtual_night(seed=1); session = night.observe()\n"
        'curve = session.reduce().calibrate().apply()["demo-sat"]\n'
        'scene = sg.Scene.load("pass.toml")\n'
        'fit = sg.fit(scene, curve, free=["albedo", "attitude.spin_axis"])\n'
        "fit.table().to_pandas(); fit.plot()\n"
        "w = scene.light(sun, observer)           # (n, 3), (n, 3) -> (n, materials), with errors\n"
    )
    before = "import matplotlib; matplotlib.use('Agg')\nimport json, numpy\nsun = numpy.eye(3); observer = sun\n"
    after = (
        "print(json.dumps(dict(shape=w.shape, materials=w.materials, error=bool((w.error_m2_per_sr >= 0).all()), sum=float(numpy.asarray(w).sum()),"
        " free=[p['name'] for p in fit['fit']['parameters']], values=[p['value'] for p in fit['fit']['parameters']], sigma=[p['sigma'] for p in fit['fit']['parameters']])))\n"
    )
    done = subprocess.run([sys.executable, "-c", before + block + after], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["shape"] == [3, 4] and len(told["materials"]) == 4 and told["error"] and told["sum"] > 0
    names = " ".join(told["free"])
    assert "attitude.axis_ra_deg" in names and "attitude.axis_dec_deg" in names and "albedo" in names
    found = dict(zip(told["free"], told["values"]))
    # The scene's axis; half a degree: ten times the stated uncertainty, a small part of the sphere.
    assert found["attitude.axis_ra_deg"] % 360 == pytest.approx(161.6, abs=0.5)
    assert found["attitude.axis_dec_deg"] == pytest.approx(71.6, abs=0.5)


def test_light_by_material_adds_up_and_is_lambert(tmp_path):
    """Truth: a face of area A and reflectance r that looks to Sun and observer at i and o sends A r / pi cos i cos o. The sum over materials is the body's light."""
    body = sg.Body("cube")
    n = 40
    sun, observer = directions(n, 5), directions(n, 6)
    by = body.light_by_material(sun, observer, 550.0)
    whole = body.light(sun, observer, wavelength_nm=[550.0])
    assert by.shape == (n, 4) and np.asarray(by).shape == (n, 4)
    assert np.allclose(np.asarray(by).sum(1) + by.several_m2_per_sr, whole.per_irradiance_m2_per_sr[:, 0], rtol=1e-12, atol=0)
    assert np.allclose(by.error_m2_per_sr.sum(1) + by.several_error_m2_per_sr, whole.error_m2_per_sr[:, 0], rtol=1e-9, atol=1e-300)
    # The face -y alone is the uniform one, of reflectance 1 (simulator/targets/cube.toml).
    cosine = np.clip(-sun[:, 1], 0, None) * np.clip(-observer[:, 1], 0, None)
    uniform = np.asarray(by)[:, by.materials.index("uniform_diffuse")]
    # The Sun is a disc: its edge matters by less than the tolerance where the face is not seen edge on.
    clear = (sun[:, 1] < -0.05) & (observer[:, 1] < -0.05)
    assert clear.sum() > 5
    assert np.allclose(uniform[clear], cosine[clear] / np.pi, rtol=2e-3)
    again = pickle.loads(pickle.dumps(by))
    assert np.array_equal(np.asarray(again), np.asarray(by)) and again.materials == by.materials


def test_recordings_are_arrays(demo):
    """Truth: the session's own files, read by astropy."""
    from astropy.io import fits
    from astropy.table import Table as Read

    session = sg.Session(demo / "session")
    assert session.counters == ["tagger"] and session.cameras == ["cam"] and session.station
    counts = session.counts()
    read = Read.read(demo / "session" / "counts" / "tagger.ecsv")
    assert counts.rows == len(read) > 100
    for column in ("start_ps", "length_ps", "flags", "id400_counts", "spcm_counts", "mppc_missed"):
        assert np.array_equal(counts[column].astype("i8"), np.asarray(read[column]).astype("i8")), column
    times = np.array([t.rstrip("Z") for t in read["start_utc"]], dtype="datetime64[ns]")
    assert np.array_equal(counts["start_utc"], times)
    frames = session.frames("cam")
    assert len(frames) > 20 and [f.number for f in frames] == sorted(f.number for f in frames)
    for frame in frames[::20]:
        with fits.open(frame.path) as file:
            assert np.array_equal(frame.pixels, file[0].data.astype("u2")) and frame.pixels.dtype == np.uint16
            assert frame.about["exposure_s"] == file[0].header["EXPTIME"]
    with pytest.raises(sg.Error, match="nothing"):
        session.counts("nothing")


def test_apertures_are_sums(tmp_path):
    """Truth: a flat frame with a block of 3 by 3 pixels that is 900 ADU brighter: 8,100 ADU in 2 s, whatever the aperture that holds it; exact to rounding."""
    pixels = np.full((80, 90), 500, dtype=np.uint16)
    pixels[39:42, 49:52] += 900
    # All noise is the read-out's: of photons' the mean lies above the median, and the library adds that.
    how = dict(radius_px=6.0, annulus_px=(9.0, 14.0), exposure_s=2.0, read_noise_e=50.0)
    table = sg.aperture(pixels, [[50.0, 40.0], [20.0, 20.0]], **how)
    assert table["rate_adu_per_s"][0] == pytest.approx(4050.0, rel=1e-6)
    assert table["rate_adu_per_s"][1] == pytest.approx(0.0, abs=1e-6)
    assert table["background_adu"] == pytest.approx([500.0, 500.0])
    assert table["area_px2"][0] == pytest.approx(np.pi * 36, rel=1e-6)
    # A disc that covers a half of a pixel counts half of it: the pixel's own column at its right edge.
    one = np.full((60, 60), 100, dtype=np.uint16)
    one[30, 36] += 1000
    half = sg.aperture(one, [[30.0, 30.0]], radius_px=6.0, annulus_px=(10.0, 15.0), read_noise_e=50.0)["rate_adu_per_s"][0]
    assert 400 < half < 500, half
    assert sg.aperture(pixels.astype(float), [50.0, 40.0], **how)["rate_adu_per_s"][0] == table["rate_adu_per_s"][0]
    with pytest.raises(ValueError, match="whole numbers"):
        sg.aperture(pixels + 0.5, [[50.0, 40.0]])


def test_apertures_of_noise_and_masks():
    """Truth: 400 places of a frame of noise alone hold no light: their mean within four of its own standard errors, whatever is not known of the gain. A hot pixel that is masked leaves the light as it is."""
    random = np.random.default_rng(5)
    frame = np.rint(random.normal(500, 3, (900, 900))).astype(np.uint16)
    places = [(30.0 + 42 * i, 30.0 + 42 * j) for i in range(20) for j in range(20)]
    rates = sg.aperture(frame, places)["rate_adu_per_s"]
    assert abs(rates.mean()) < 4 * rates.std() / math.sqrt(len(rates)), rates.mean()
    hot = np.ma.masked_array(frame.copy(), mask=np.zeros(frame.shape, bool))
    hot.data[30, 33] = 60000
    hot.mask[30, 33] = True
    found = sg.aperture(hot, places[:1])
    assert abs(found["rate_adu_per_s"][0] - rates[0]) < 20, found
    assert found["masked_fraction"][0] > 0
    units = pytest.importorskip("astropy.units")
    with pytest.raises(units.UnitConversionError):
        sg.aperture(frame * units.electron, places)


def test_arrays_say_what_is_wrong_with_them():
    """What a text, a mask, a wrong length or a wrong unit would quietly have become; each by hand."""
    times = [f"2026-01-01T20:00:0{i}Z" for i in range(6)]
    m = np.ma.masked_array([5.0, 5.1, 30.0, 5.2, 5.3, 5.4], mask=[0, 0, 1, 0, 0, 0])
    curve = sg.Curve.from_arrays(times, m, sigma_mag=0.1, target="sat 1", filter="V, wide")
    assert curve.target == "sat 1" and pickle.loads(pickle.dumps(curve)).target == "sat 1"
    assert 30.0 not in curve.table["magnitude"] and set(curve.table["filter"]) == {"V, wide"}
    for wrong, told in [
        (dict(filter=["B"]), "filter has 1 names, expected 6"),
        (dict(sigma_mag=[0.1, 0.2]), "sigma_mag has the shape"),
        (dict(sigma_mag=-0.1), "expected an uncertainty"),
    ]:
        with pytest.raises(sg.Error, match=told):
            sg.Curve.from_arrays(times, m, **wrong)
    with pytest.raises(ValueError, match="of the year 1500"):
        sg.Curve.from_arrays(np.array(["1500-01-01"] * 6, "M8[s]"), m)
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"time": pandas.to_datetime([t.rstrip("Z") for t in times]), "mag": m.data})
    there = sg.Curve.from_arrays(frame["time"], frame["mag"])
    assert list(there.table["time_utc"]) == list(sg.Curve.from_arrays(times, m.data).table["time_utc"])
    for place in ("18h36m 38d", (1, 2, 3)):
        with pytest.raises(sg.Error, match="place"):
            sg.star("mine", times[0], "ufo", place=place, v_mag=1, spectral_type="A0V")
    sphere = sg.Body("lambert_sphere")
    with pytest.raises(sg.Error, match="row 1 is nan"):
        sphere.light([[1, 0, 0]] * 2, [[1, 0, 0]] * 2, range_m=[5, np.nan])
    with pytest.raises(sg.Error, match="expected a whole number of 1 or more"):
        sphere.picture(-1)
    with pytest.raises(sg.Error, match="there is no curve"):
        sg.period([])
    with pytest.raises(ValueError, match="read-only"):
        curve.table["magnitude"][0] = 1
    error = pytest.raises(sg.Error, sg.Body, "nosuch").value
    assert str(pickle.loads(pickle.dumps(error))) == str(error) and type(error).__module__ == "sunglint"
    result = sg.star("Vega", times[0], "ufo")
    assert "station" in result and set(result) == set(result.summary) and result.get("none", 3) == 3
    travelled = pickle.loads(pickle.dumps(result))
    assert travelled.encode("csv") == result.encode("csv") and travelled.encode("json")


def test_devices_are_the_programs(tmp_path):
    """Simulated devices: their numbers are the program's; a stage stays where it was sent; a recording replays in the program."""
    theirs = json.loads(program("devices", "read", "sim-pm100", "--with", "power_w=2e-6", "-n", "2", "--json", "-q"))
    with sg.Device("sim-pm100", {"power_w": 2e-6}) as meter:
        mine = meter.read(count=2)
    assert meter.kind == "power meter"
    assert [r["power_w"] for r in mine["readings"]] == [r["power_w"] for r in theirs["readings"]]
    recording = tmp_path / "stage.rec"
    stage = sg.Device("sim-tmcl", record=recording)
    moved = stage.move(30, 45.5)
    theirs = json.loads(program("devices", "move", "sim-tmcl", "30", "45.5", "--json", "-q"))
    assert [m["angle_deg"] for m in moved["moves"]] == [m["angle_deg"] for m in theirs["moves"]]
    assert stage.read()["readings"][0]["angle_deg"] == moved["moves"][-1]["angle_deg"]
    stage.close()
    with pytest.raises(sg.Error, match="closed"):
        stage.read()
    assert recording.stat().st_size > 100
    with pytest.raises(sg.Error, match="slot|angle"):
        sg.Device("sim-tmcl").move("nowhere")
    listed = json.loads(program("devices", "list", "--drivers", "--json", "-q"))
    same(sg.drivers().summary, listed)
    with pytest.raises(sg.Error):
        sg.Device("no-such-driver")


def test_tracking_is_the_programs(demo):
    for more, options in ((["--dry-run"], dict(dry_run=True)), ([], {})):
        arguments = [demo / "satellites.tle", "99004", "--mount", "virtual", "--at", "2020-11-18T16:20:00Z", "--station", "ufo", "--for-s", "60", *more]
        theirs = json.loads(program("track", *arguments, "--json", "-q"))
        mine = sg.track(demo / "satellites.tle", 99004, "2020-11-18T16:20:00Z", station="ufo", for_s=60, **options)
        same(mine.summary, theirs, COSTS)
    assert mine.table.rows > 100 and mine["true_rms_arcsec"] < 30
    with pytest.raises(sg.Error, match="virtual-german"):
        sg.track(demo / "satellites.tle", 99004, "2020-11-18T16:20:00Z", station="ufo", mount="indi-telescope")


def test_ctrl_c_ends_a_rehearsal(tmp_path):
    """Eleven hours of a synthetic geostationary satellite at ten frames a second: half a minute of work or more."""
    (tmp_path / "geo.tle").write_text('GEO\n1 99998U 20001A   20323.50000000  .00000000  00000+0  00000+0 0  9990\n2 99998   0.0500 240.0000 0002000   0.0000   0.0000  1.00270000    10\n')
    code = (
        "import signal, sunglint as sg\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "print('ready', flush=True)\n"
        "try:\n    sg.track('geo.tle', 99998, '2020-11-18T16:20:00Z', station='ufo', for_s=40000); print('done')\n"
        "except KeyboardInterrupt:\n    print('heard', flush=True)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=tmp_path)
    assert child.stdout.readline() == "ready\n"
    time.sleep(0.5)
    child.send_signal(signal.SIGINT)
    try:
        heard, _ = child.communicate(timeout=120)
    finally:
        child.kill()
    assert heard == "heard\n"


def ggx_retro(tmp_path):
    """A run of retro-reflection of a GGX surface (see test_microfacets_are_the_programs; synthetic)."""
    rows = ["# %ECSV 1.0", "# ---", "# datatype:"]
    rows += [f"# - {{name: {name}, datatype: float64, unit: {unit}}}" for name, unit in (("angle_deg", "deg"), ("f_per_sr", "1 / sr"), ("sigma_f_per_sr", "1 / sr"))]
    rows += ["# meta: {kind: retro_reflection, wavelength_nm: 632.8, cone_half_angle_deg: 0.5, scale_sigma: 0.02}", "angle_deg f_per_sr sigma_f_per_sr"]
    for angle in np.arange(-10.0, 65.5, 0.5):
        t2, cos2 = math.tan(math.radians(angle)) ** 2, math.cos(math.radians(angle)) ** 2
        d = 1 / (math.pi * (0.2 * cos2 * (1 + t2 / 0.04)) ** 2)
        f = 0.9 * d * 2 / (1 + math.sqrt(1 + 0.04 * t2)) / (4 * cos2)
        rows.append(f"{angle} {f!r} {0.01 * f!r}")
    table = tmp_path / "retro.ecsv"
    table.write_text("\n".join(rows) + "\n")
    return table


def test_plans_and_assembled_materials_are_the_programs(tmp_path):
    """The same file of a material, byte for byte. Truth of its values: a Lambert surface of reflectance 0.5, whose samples it was made of (2 %: the grid's own)."""
    density = sg.ndf(ggx_retro(tmp_path), resamplings=5)
    density.write(tmp_path / "ndf.ecsv")
    theirs = json.loads(program("brdf", "plan", tmp_path / "ndf.ecsv", "--theta-i", "4", "--side", "8", "--json", "-q"))
    planned = sg.plan(tmp_path / "ndf.ecsv", theta_i=4, side=8)
    same(planned.summary, theirs, COSTS)
    assert planned.table.rows > 50
    theirs = json.loads(program("brdf", "plan", tmp_path / "ndf.ecsv", "--rig", "--least-phase-deg", "25", "--json", "-q"))
    same(sg.plan(tmp_path / "ndf.ecsv", rig={"least_phase_deg": 25}).summary, theirs, COSTS)
    rows = ["theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_per_sr"]
    for incidence in (0, 20, 40, 60, 75):
        for o in range(0, 85, 6):
            for azimuth in range(0, 360, 30):
                rows.append(f"{incidence},0,{o},{azimuth},{0.5 / math.pi:.9g}")
    samples = tmp_path / "samples.csv"
    samples.write_text("\n".join(rows) + "\n")
    options = ["--wavelength-nm", "550", "--theta-i", "12", "--side", "17", "--normals", "48"]
    program("brdf", "assemble", samples, tmp_path / "ndf.ecsv", "-o", tmp_path / "theirs.bsdf", *options, "-q")
    made = sg.assemble(samples, tmp_path / "ndf.ecsv", wavelength_nm=550, theta_i=12, side=17, normals=48)
    assert made.bsdf == (tmp_path / "theirs.bsdf").read_bytes()
    made.write(tmp_path / "mine.bsdf")
    assert (tmp_path / "mine.toml").read_text() == (tmp_path / "theirs.toml").read_text().replace("theirs", "mine")
    light = np.array([[0.0, 0.0, 1.0]])
    observer = np.array([[math.sin(0.5), 0.0, math.cos(0.5)]])
    assert made.brdf(550).evaluate(550, light, observer)[0] == pytest.approx(0.5 / math.pi, rel=0.02)
    assert pickle.loads(pickle.dumps(made)).bsdf == made.bsdf


def test_retro_reflection_is_the_programs(tmp_path):
    """The virtual rig of docs/lab.md: the same table of the same readings."""
    page = (ROOT / "docs" / "lab.md").read_text()
    blocks = [b.split("```", 1)[0] for b in page.split("```toml\n")[1:]]
    run = next(b for b in blocks if b.startswith('virtual = "rig.toml"'))
    (tmp_path / "rig.toml").write_text(next(b for b in blocks if 'kind = "ggx"' in b))
    (tmp_path / "run.toml").write_text(run)
    program("brdf", "retro", "run.toml", "-o", "theirs/", "-q", cwd=tmp_path)
    mine = sg.retro(tmp_path / "run.toml", tmp_path / "mine")
    theirs = sg.read_table(tmp_path / "theirs" / "retro.ecsv")
    assert list(mine.table) == list(theirs)
    for column in theirs:
        assert np.array_equal(mine.table[column], theirs[column], equal_nan=theirs[column].dtype.kind == "f"), column
    again = sg.retro(tmp_path / "run.toml", tmp_path / "theirs", reduce=True)
    assert again.to_json() == mine.to_json().replace(str(tmp_path / "mine"), str(tmp_path / "theirs"))
    with pytest.raises(sg.Error, match="begun|go on"):
        sg.retro(tmp_path / "run.toml", tmp_path / "mine")


def test_figures_are_axes(scene):
    """Truth: the numbers of the result's own table are those of the lines."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    result = sg.Scene(scene, station="ufo").simulate(step_s=10)
    axes = np.atleast_1d(np.asarray(result.plot(), dtype=object))
    drawn = {line.get_label(): line.get_ydata() for ax in axes for line in ax.lines}
    columns = [v for v in result.table.values() if getattr(v, "dtype", object) == np.float64 and v.ndim == 1]
    assert any(len(y) == len(c) and np.array_equal(np.asarray(y), c, equal_nan=True) for y in drawn.values() for c in columns), drawn.keys()
    assert all(ax.get_ylabel() for ax in axes) and axes[-1].get_xlabel()
    again = pickle.loads(pickle.dumps(result))
    ax = pyplot.figure().add_subplot()
    assert again.plot(ax) is ax and ax.lines
    two = pyplot.subplots(len(axes) + 3)[1]
    with pytest.raises(ValueError, match="axes for"):
        result.plot(two)
    # A field of values, and marks on a sky.
    sg.body_map(scene, step_deg=30).plot()
    pyplot.close("all")


def test_astropys_times_quantities_and_places(demo):
    """Truth: the same calls with plain numbers and texts."""
    from astropy import units as u
    from astropy.coordinates import CartesianRepresentation, SkyCoord
    from astropy.table import QTable
    from astropy.time import Time

    when = Time("2020-11-18T18:00:00", scale="utc")
    plain = sg.star("mine", "2020-11-18T18:00:00Z", "ufo", place=(279.2, 38.8), v_mag=1.0, b_minus_v_mag=0.0, exposure_s=0.1)
    asked = sg.star("mine", when.tt, "ufo", place=SkyCoord(279.2 * u.deg, 38.8 * u.deg), v_mag=1.0, b_minus_v_mag=0.0, exposure_s=100 * u.ms)
    same(asked.summary, plain.summary, COSTS)
    assert sg.air([0, 60] * u.deg, wavelength_nm=[450, 550] * u.nm, altitude_m=0.5 * u.km).to_json() == sg.air([0, 60], wavelength_nm=[450, 550], altitude_m=500).to_json()
    turn = np.array([[0.0, 0.6, 0.8]])
    body = sg.Body("cube")
    mine = body.light(CartesianRepresentation(*turn.T), SkyCoord(10 * u.deg, 20 * u.deg), wavelength_nm=550 * u.nm, range_m=800 * u.km)
    unit = SkyCoord(10 * u.deg, 20 * u.deg).cartesian.xyz.value
    assert np.array_equal(mine.per_irradiance_m2_per_sr, body.light(turn, unit, range_m=8e5).per_irradiance_m2_per_sr)
    folded = sg.fold(demo / "sphere.ecsv", period_s=2 * u.min, epoch=when, station="ufo")
    assert folded.to_json() == sg.fold(demo / "sphere.ecsv", period_s=120.0, epoch="2020-11-18T18:00:00Z", station="ufo").to_json()
    table = sg.read_table(demo / "sphere.ecsv")
    read = table.to_astropy()
    assert isinstance(read, QTable) and isinstance(read["time_utc"], Time)
    assert [t + "Z" for t in read["time_utc"].isot][:3] == [str(np.datetime_as_string(t, unit="ns")) + "Z" for t in table.times()][:3]
    assert read["range_m"].unit == u.m


def test_notebooks_see_pictures(scene):
    body = sg.Body("cube")
    assert body._repr_png_()[:4] == b"\x89PNG" and body._repr_png_() == body.picture()
    shown = sg.Scene(scene)._repr_html_()
    assert "data:image/png;base64," in shown and "box_wing" in shown
    assert pickle.loads(pickle.dumps(sg.Scene(scene).body)).materials == sg.Scene(scene).body.materials
    table = sg.Scene(scene, station="ufo").simulate(step_s=20).table
    html = table._repr_html_()
    assert html.count("<tr>") == len(table) and "<svg" in html and table() is table


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
    # Nothing else than numpy and what Python has: how long it takes is numpy's affair (python/clean measures it).
    code = "import sys, __future__, numpy, dataclasses, json, tempfile; there = set(sys.modules); import sunglint; print(sorted(set(sys.modules) - there))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "['sunglint', 'sunglint._core']\n"


def test_what_python_costs_can_be_measured():
    """python/overhead with few geometries: that it runs, and says each number for each body. The numbers are not asserted: they are the machine's."""
    done = subprocess.run([sys.executable, ROOT / "python" / "overhead", "400", "2"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for wanted in ("a call with one geometry", "light of", "an engine in a ThreadPoolExecutor"):
        assert done.stdout.count(wanted) == 4, done.stdout


def test_the_guides_examples_run(tmp_path, scene):
    """The blocks of docs/python.md, one after the other, where the demonstration's files lie."""
    page = (ROOT / "docs" / "python.md").read_text()
    blocks = [b.split("```", 1)[0] for b in page.split("```python\n")[1:]]
    assert blocks
    code = "import matplotlib; matplotlib.use('Agg')\n" + "\n".join(blocks)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=scene.parent)
    assert done.returncode == 0, done.stderr
