"""Called by benches/against_mitsuba: PROGRAM PEER [SCENE...]. Runs both programs in turn and prints the table."""
import csv, datetime, importlib.metadata, json, os, pathlib, platform, statistics, subprocess, sys, tempfile

TOP = pathlib.Path(__file__).resolve().parent.parent
SCENES = ["lambert_sphere", "box_wing", "box_wing_diffuse", "corner", "dense_sphere", "dense_satellite"]
SPP = [4, 16, 64, 256]
# One sample for each bin and pixel, to the 80 of the thesis; of the dense scenes the last would take minutes.
HIST = {False: [47, 188, 752, 3760], True: [47, 188, 752]}
SECONDS = 2.0


def note(text):
    print(text, file=sys.stderr, flush=True)


def lines(command, **kw):
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, **kw)
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def sums(scene, column):
    with open(TOP / "simulator/scenes/exact.ecsv") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return {r["material"]: float(r[column]) for r in rows if r["scene"] == scene}


def time_text(s):
    for size, unit in ((1e-6, "ns"), (1e-3, "µs"), (1.0, "ms"), (float("inf"), "s")):
        if s < size:
            value = s / {"ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "s": 1.0}[unit]
            return "%.*f %s" % (2 if value < 10 else 1 if value < 100 else 0, value, unit)


def two_digits(x):
    return "{:,.0f}".format(float("%.2g" % x)) if x >= 10 else "%.2g" % x


def main():
    program, peer, wanted = sys.argv[1], sys.argv[2], sys.argv[3:] or SCENES
    unknown = [name for name in wanted if name not in SCENES]
    if unknown:
        sys.exit("no such scene: %s; there are %s" % (", ".join(unknown), ", ".join(SCENES)))
    start = datetime.datetime.now(datetime.timezone.utc)
    load = [os.getloadavg()[0]]
    table, first, slower = [], [], []
    for scene in wanted:
        ours = []

        def we():
            ours.append(lines([program, "bench", "--scene", scene, "--seconds", str(SECONDS), "--json", "-q"]))

        def mitsuba(mode, variant, spp):
            note("%s: Mitsuba, %s" % (scene, mode))
            command = [sys.executable, peer, "run", "--scene", scene, "--variant", variant, "--mode", mode, "--threads", "1",
                       "--sampler", "multijitter", "--max-depth", "2", "--repeats", "5", "--spp", *map(str, spp)]
            rational = sums(scene, "weight_rational_m2_sr")
            with tempfile.TemporaryDirectory() as folder:
                if rational and scene != "dense_sphere":
                    path = os.path.join(folder, "direct.json")
                    with open(path, "w") as file:
                        json.dump(rational, file)
                    command += ["--direct", path]
                return lines(command)

        dense = scene.startswith("dense")
        we()
        theirs = [("grey", 1, mitsuba("mono", "llvm_ad_mono", SPP))]
        we()
        theirs.append(("per material", 188, mitsuba("basis", "llvm_ad_mono", SPP)))
        we()
        theirs.append(("thesis loop", 188, mitsuba("hist", "llvm_ad_spectral", HIST[dense])))
        we()
        own = {}
        for bins in (1, 188):
            names = []
            for run in ours:
                names += [r["engine"] for r in run if r["bins"] == bins and r["engine"] not in names]
            own[bins] = []
            for name in (n for n in names if n == "exact" or n.startswith("tolerance")):
                rows = [r for run in ours for r in run if r["bins"] == bins and r["engine"] == name]
                # One direction may be met by chance: a sampled sum counts with a third of the error that it states (three standard deviations).
                error, stated = rows[0]["relative_error"], rows[0]["error_estimate"]
                counts = error if name == "exact" or error is None else max(error, stated / 3)
                seconds = statistics.median(r["seconds_per_epoch"] for r in rows)
                own[bins].append((seconds, counts))
                label = "sunglint, %s%s" % ("grey" if bins == 1 else "188 bins", "" if name == "exact" else ", " + name)
                text = "-" if error is None else "%.1e (%s%s)" % (error, rows[0]["error_source"], "" if name == "exact" else "; stated %.1e" % stated)
                table.append((scene, label, "", time_text(seconds), text, ""))
        for way, bins, rows in theirs:
            for row in rows:
                theirs_s, theirs_e = row["cpu_seconds"], row.get("rel_error")
                enough = [s for s, e in own[bins] if theirs_e is not None and e is not None and e <= theirs_e]
                if theirs_e is None:
                    ratio = "no truth"
                elif not enough:
                    ratio = "ours is not as exact"
                else:
                    ratio = two_digits(theirs_s / min(enough))
                table.append((scene, "Mitsuba, %s" % way, str(row["spp"]), time_text(theirs_s), "-" if theirs_e is None else "%.1e" % theirs_e, ratio))
                first.append(row["first_seconds"]); slower.append(row["seconds"] / row["cpu_seconds"])
        load.append(os.getloadavg()[0])
    version = subprocess.run([program, "--version"], stdout=subprocess.PIPE, text=True, check=True).stdout.split()[-1]
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], stdout=subprocess.PIPE, text=True, cwd=TOP).stdout.strip()
    cpu = next((l.split(":")[1].strip() for l in open("/proc/cpuinfo") if l.startswith("model name")), platform.processor())
    llvm = os.path.basename(os.environ.get("DRJIT_LIBLLVM_PATH", ""))
    print("sunglint %s (%s) beside Mitsuba %s (drjit %s, %s, Python %s), %s, one thread each, %s UTC." % (
        version, commit, importlib.metadata.version("mitsuba"), importlib.metadata.version("drjit"), llvm, platform.python_version(),
        cpu, start.strftime("%Y-%m-%d %H:%M")))
    print("The system's load on its %d cores was %.1f to %.1f." % (os.cpu_count(), min(load), max(load)))
    print("""
Single scattering under a collimated Sun. Time: sunglint, wall time of one epoch, median of many stretches in four runs before, between
and after Mitsuba's; Mitsuba, CPU time of one render (60 x 60 pixels, `multijitter`), median of 5 after a warm-up. Making the scene and
Mitsuba's first render (JIT, %s to %s) are in no time; on this machine its wall time was %.2f times its CPU time (median). Error:
sum |E - truth| / sum truth over the bins; Mitsuba's, the root mean square over 5 seeds, against the exact sums with the rational
fit of Smith's masking that it evaluates; ours, against those with the closed form; a sum at a tolerance counts with a third of the error
that it states, if that is more. Ratio: Mitsuba's time over that of our fastest row whose error is no larger (below 1, Mitsuba is the faster one at that error). `grey` is one number and the fairest bound for any
Mitsuba script; `per material` is one grey render for each material times spectra, as a careful user does it; the `thesis loop` traces
wavelengths (3760 samples: the thesis's 80 for each bin and pixel).
""" % (time_text(min(first)), time_text(max(first)), statistics.median(slower)))
    print("| scene | way | samples per pixel | time per epoch | error | ratio |\n| --- | --- | ---: | ---: | ---: | ---: |")
    last = None
    for scene, *rest in table:
        print("| %s | %s |" % (scene if scene != last else "", " | ".join(rest)))
        last = scene


if __name__ == "__main__":
    main()
