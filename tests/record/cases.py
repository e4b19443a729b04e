"""What the record runs, and what may differ from one run of one program to the next.

A case is one or more command lines in a fresh folder, which holds `in/`: the inputs that prepare.py made. See case() for what else a case may have.
"""

import re

CASES = []


def case(
    name,
    *commands,
    copy=(),
    edit=None,
    write=None,
    env=None,
    stdin=None,
    slow=False,
    limit_s=600,
    interrupt_s=None,
    tool=None,
    tries=1,
):
    """Adds a case.

    copy: inputs that are copied into the folder (`in/...`). edit: {name: (input, [(old, new), ...])}, a changed copy. write: {name: text}, a new file; None makes
    a folder. env: what is added to the environment, with {prepared} for the folder of the inputs. stdin: a text; without it there is none. slow: left out by --quick.
    interrupt_s: Ctrl-C comes after so many seconds. tool: words before the program's own, such as faketime's. tries: so often it is run until it does the same: for what
    depends on how busy the computer is.
    """
    CASES.append(
        {
            "name": name,
            "commands": list(commands),
            "copy": list(copy),
            "edit": edit or {},
            "write": write or {},
            "env": env or {},
            "stdin": stdin,
            "slow": slow,
            "limit_s": limit_s,
            "interrupt_s": interrupt_s,
            "tool": tool,
            "tries": tries,
        }
    )


def formats(name, command, product, *endings, **more):
    """A command once as text, once as JSON, once into a folder, once into a file of each ending."""
    case(f"{name}/text", command, **more)
    case(f"{name}/json", f"{command} --json", **more)
    files = " ".join(f"-o {product}.{ending}" for ending in endings)
    case(f"{name}/files", f"{command} -o out/ {files}", **more)


def refused(name, *commands, **more):
    """Command lines that fail: messages and exit codes. Each is its own command in one case."""
    case(f"{name}/refused", *commands, **more)


# --- help, completions, manual ----------------------------------------------------------------------------------------------------------------------------

COMMANDS = {
    "": "",
    "demo": "",
    "tables": "",
    "air": "",
    "star": "",
    "simulate": "",
    "compare": "",
    "explain": "",
    "picture": "",
    "passes": "",
    "reduce": "",
    "align": "",
    "bench": "",
    "brdf": "retro ndf plan ingest fit assemble show compare",
    "efficiency": "",
    "devices": "list check read set move record replay udev",
    "observe": "",
    "session": "check",
    "calibrate": "",
    "apply": "",
    "fit": "",
    "analyse": "fold period unmix map attitude endmembers",
    "completions": "",
    "man": "",
}
for command, parts in COMMANDS.items():
    lines = [f"{command} --help".strip(), f"{command} -h".strip()]
    for part in parts.split():
        lines += [f"{command} {part} --help", f"{command} {part} -h"]
    case(f"help/{command or 'all'}", *lines)
case("help/narrow", "air --help", "fit --help", env={"COLUMNS": "60"})
case("help/wide", "air --help", "fit --help", env={"COLUMNS": "200"})
case("help/version", "--version", "-V", "air --version", "help air", "help brdf ndf", "help nothing")
case("help/refused", "", "nothing", "ai --station ufo", "--json", "brdf", "devices", "analyse", "session", "analyse perio x", "air --sed 3", "air --seed x", "air --threads 0")
case("completions/all", *[f"completions {shell}" for shell in ["bash", "zsh", "fish", "elvish", "powershell"]])
case("completions/refused", "completions", "completions tcsh", "completions bash zsh")
case("man/all", "man -o man", "man -o man", "man -o man --force", "man -o quiet -q", "man", "man -o deep/er", "man -o in/lab/run.toml")

# --- tables -----------------------------------------------------------------------------------------------------------------------------------------------

case("tables/list", "tables", "tables --json", "tables -q", "tables -v", "tables -o all.ecsv -o all.csv -o all.json")
NAMES = "sun vega johnson_ubv stellar_library bright_stars refractive_indices air_us_standard earth_orientation molecular_bands".split()
case("tables/show", *[f"tables {name}" for name in NAMES])
case("tables/json", *[f"tables {name} --json" for name in NAMES])
case("tables/files", *[f"tables {name} -q -o {name}.ecsv -o {name}.csv -o {name}.fits -o {name}.json" for name in NAMES])
case("tables/figures", "tables sun -o sun/ -o sun.svg -o sun.png", "tables refractive_indices -o n.svg -o n.png", "tables vega -o vega.png")
refused(
    "tables",
    "tables nothing",
    "tables sn",
    "tables sun -o sun.xlsx",
    "tables sun -o nowhere/sun.ecsv",
    "tables bright_stars -o s.ecsv -o s.png",
    "tables air",
    "tables sun sun",
)

# --- air --------------------------------------------------------------------------------------------------------------------------------------------------

formats("air", "air --station ufo --zenith 0,60 --components", "a", "ecsv", "csv", "fits", "json", "png", "svg")
case("air/stdout", "air --station ufo -o -", "air --station ufo -o - -q", "air --station ufo -z 0 --points -o - --from-nm 500 --to-nm 510")
case(
    "air/options",
    "air --altitude-m 2400 --profile us_standard --water-mm 3 --ozone-du 280 --aerosol 0.05,1.3",
    "air --station ufo --apparent -z 85,89",
    "air --station ufo --no-refraction -z 85",
    "air --station ufo --from-nm 400 --to-nm 500 --points --step-nm 5",
    "air --station ufo --co2-ppm 420 --pressure-hpa 970 -v",
    "air --station ufo -vv --threads 1",
    "air --station ufo -q",
    "air --station ufo --from-nm 1000 --to-nm 1045 --step-nm 0.5 --components --json",
)
case(
    "air/models",
    *[f"air --station ufo -z 0,70 --aerosol {model} --step-nm 20" for model in "none rural_23km rural_5km maritime_23km urban_5km tropospheric_50km rural_23km_summer".split()],
    *[f"air --altitude-m 0 -z 0,70 --profile {profile} --step-nm 20 --components --json" for profile in "tropical midlatitude_summer midlatitude_winter subarctic_summer subarctic_winter us_standard".split()],
)
case(
    "air/warnings",
    "air --station ufo -z 0 --pressure-hpa 29.9",
    "air --station ufo -z 0 --ozone-du 0.3",
    "air --station ufo -z 0 --ozone-du 0.3 -q",
    "air --station ufo -z 0 --aerosol 0.1,5",
    "air -z 0 --altitude-m 2400 --profile us_standard --pressure-hpa 1013",
)
case(
    "air/stations",
    "air -z 0 --json",
    "air -z 0 --station in/fixtures/passes/mmt9",
    "air -z 0 --station in/six_bands/station.toml -v",
    env={"SUNGLINT_STATION": "in/fixtures/passes/mmt9/station.toml"},
)
case("air/own_station", "air -z 0 -v", copy=["in/six_bands/station.toml", *[f"in/six_bands/g{c}.csv" for c in (531, 639, 746, 854, 961, 1069)]])
refused(
    "air",
    "air",
    "air --station uf",
    "air --station nowhere/station.toml",
    *[
        f"air --station ufo {wrong}"
        for wrong in [
            "--zenith 95",
            "--zenith NaN",
            "--zenith 0,91,92,93",
            "--zenith 30,30",
            "--zenith x",
            "--ozone-du -3",
            "--ozone-du=-3",
            "--profile tropicl",
            "--from-nm 200",
            "--from-nm 0.55",
            "--to-nm 1250",
            "--to-nm 1251 --points",
            "--from-nm 600 --to-nm 500",
            "--step-nm 0",
            "--step-nm 1e-9",
            "--step-nm 2000",
            "--pressure-hpa -1",
            "--water-mm -1",
            "--co2-ppm -1",
            "--aerosol smog",
            "--aerosol -0.1,1.3",
            "--altitude-m 300",
            "--nonsense",
            "-o a.xlsx",
            "-o a",
            "-o -  --json",
            "-o a.csv -o a.csv",
            "-o nowhere/a.csv",
            "-q -v",
        ]
    ],
)
case("air/twice", "air --station ufo -z 0 --step-nm 10 -o a.ecsv", "air --station ufo -z 0 --step-nm 10 -o a.ecsv", "air --station ufo -z 0 --step-nm 5 -o a.ecsv --force")
STATION = "in/six_bands/station.toml"
for name, old, new in [
    ("unknown_key", "height_m = 400.0", "heigth_m = 400.0"),
    ("bad_value", "height_m = 400.0", 'height_m = "high"'),
    ("negative", "primary_diameter_m = 0.43", "primary_diameter_m = -0.43"),
    ("no_file", 'efficiency = "g531.csv"', 'efficiency = "g5.csv"'),
    ("no_toml", "[site]", "[site"),
]:
    case(f"air/station_{name}", "air --station station.toml -z 0", "star Vega --station station.toml --at 2020-11-18T18:00:00", edit={"station.toml": (STATION, [(old, new)])})

# --- star -------------------------------------------------------------------------------------------------------------------------------------------------

VEGA = "star Vega --station ufo --at 2020-11-18T18:00:00"
formats("star/moment", f"{VEGA} --spectrum-out s.ecsv --spectrum-out s.fits --spectrum-out s.csv --spectrum-out s.json", "v", "ecsv", "csv", "fits", "json")
formats("star/night", "star 'alpha Orionis' --station ufo --at 2020-11-18T20:00:00 --to 2020-11-19T04:00:00 --step-s 1800", "n", "ecsv", "csv", "fits", "json", "png", "svg")
case(
    "star/earth_orientation",
    "tables earth_orientation -q -o eo.ecsv",
    f"{VEGA} --earth-orientation eo.ecsv --json",
    "passes --tle in/demo/satellites.tle --station ufo --from 2020-11-18T15:00:00 --to 2020-11-18T18:00:00 --limit 1 --earth-orientation eo.ecsv",
)
case(
    "star/options",
    f"{VEGA} --exposure-s 0.4 --zero-point ab -v",
    f"{VEGA} --spectrum black-body",
    f"{VEGA} --type Q9",
    f"{VEGA} --spectrum-out v.png",
    f"{VEGA} --v=-12",
    f"{VEGA} --aerosol rural_23km --profile us_standard --json",
    "star 'HIP 97649' --station ufo --at 2020-11-18T16:00:00 --to 2020-11-18T23:00:00 --step-s 3600",
    "star Mine --ra 300 --dec 20 --v 5 --bv 0.6 --type G2V --pm-ra 100 --pm-dec -50 --parallax 20 --epoch-year 2016 --station ufo --at 2020-11-18T18:00:00",
    "star Mine --ra 300 --dec 20 --v 5 --bv 0.6 --station ufo --at 2020-11-18T18:00:00 --json",
    "star 'Deneb' --station in/fixtures/passes/mmt9 --at 2020-11-18T16:00:00",
    "star Sirius --station ufo --at 1850-01-01",
    "star Sirius --station ufo --at 2020-11-18T18:00:00",
    "star Betelgeuse --station ufo --at 2016-12-31T23:59:60Z",
)
refused(
    "star",
    "star",
    "star Vegaa --station ufo --at 2020-11-18T18:00:00",
    "star nothing --station ufo --at 2020-11-18T18:00:00",
    "star Vega --station ufo --at 2040-02-30",
    "star Vega --station uf --at 2020-11-18T18:00:00",
    "star Vega --station ufo --at yesterday",
    "star Vega --station ufo --at 2020-13-18",
    "star Vega --station ufo --at 2020-11-18T18:00:00 --to 2020-11-18T17:00:00",
    f"{VEGA} --step-s 5",
    f"{VEGA} --to 2020-11-18T19:00:00 --step-s 0",
    f"{VEGA} --exposure-s 0",
    f"{VEGA} --zero-point jansky",
    f"{VEGA} --ra 400 --dec 0",
    f"{VEGA} --spectrum green",
    f"{VEGA} --earth-orientation nowhere.ecsv",
    f"{VEGA} -o v.html",
    f"{VEGA} --spectrum-out v.pdf",
    "star New --ra 10 --dec 10 --station ufo --at 2020-11-18T18:00:00",
)

# --- simulate, explain ------------------------------------------------------------------------------------------------------------------------------------

SCENES = "in/scenes"
formats("simulate/sphere", f"simulate {SCENES}/sphere_pass.toml", "s", "ecsv", "csv", "fits", "json", "png", "svg")
formats("simulate/box_wing", "simulate in/demo/pass.toml --step-s 10", "b", "ecsv", "fits")
case("simulate/stdout", f"simulate {SCENES}/sphere_pass.toml -o -", f"simulate {SCENES}/sphere_pass.toml -o - -q --threads 1")
case(
    "simulate/options",
    "simulate in/demo/pass.toml --from 2020-11-18T16:25:00 --to 2020-11-18T16:25:20 --step-s 1 --tolerance 1% --json",
    "simulate in/demo/pass.toml --from 2020-11-18T16:25:00 --to 2020-11-18T16:25:10 --step-s 0.1 --tolerance 5% -v -o c.ecsv",
    "simulate in/demo/sphere.toml --station in/fixtures/passes/mmt9 --step-s 30",
    "simulate in/demo/sphere.toml --station in/six_bands --step-s 30 --json",
    f"simulate {SCENES}/one.toml",
    f"simulate {SCENES}/one.toml --json -v",
    f"simulate {SCENES}/one.toml --from 2008-09-21T20:48:00 --station ufo",
)
for scene in ["orbit_law", "inertial_law", "sun_law", "yaw_steering_law", "tumble", "pointing"]:
    case(f"simulate/scene_{scene}", f"simulate {SCENES}/{scene}.toml --tolerance 5% -o {scene}.ecsv -o {scene}.fits --json")
case("simulate/scene_foil", f"simulate {SCENES}/foil_model.toml --json", slow=True)
for scene in [
    "all_models",
    "dish_and_wing",
    "all_effects",
    "no_effects",
    "earth_table",
    "irradiance",
    "no_air",
    "mesh_obj",
    "mesh_glb",
    "mesh_smooth",
    "shapes",
    "ephemeris",
    "corner",
]:
    case(f"simulate/scene_{scene}", f"simulate {SCENES}/{scene}.toml -o {scene}.ecsv -o {scene}.fits --json", f"explain {SCENES}/{scene}.toml --json")
for kind in ["prism_binary.stl", "prism_text.stl", "prism_inside.gltf", "prism_beside.gltf", "prism_big.ply", "prism_little.ply", "prism_text.ply"]:
    case(
        f"simulate/mesh_{kind.replace('.', '_')}",
        "simulate mesh.toml -o mesh.ecsv",
        edit={"mesh.toml": ("in/scenes/mesh_obj.toml", [("../fixtures/meshes/prism.obj", f"in/fixtures/meshes/{kind}")])},
    )
formats("simulate/active", f"simulate {SCENES}/active.toml --active --from 2008-09-21T18:46:00 --to 2008-09-21T18:50:00 --step-s 20", "a", "ecsv", "fits", "png", "svg")
case("simulate/active_bounces", "simulate corner.toml --active --laser debris --json", edit={"corner.toml": ("in/scenes/active.toml", [("lambert_sphere", "corner")])})
formats("explain", f"explain {SCENES}/sphere_pass.toml", "e", "ecsv", "csv", "json")
case(
    "explain/options",
    "explain in/demo/pass.toml",
    "explain in/demo/pass.toml --tolerance 1%",
    "explain in/demo/pass.toml --tolerance 0.00001 -v",
    "explain in/demo/sphere.toml --station in/six_bands",
    f"explain {SCENES}/corner.toml -q",
    "explain in/demo/pass.toml --tolerance '0.2 %' --json",
)
refused(
    "simulate",
    "simulate",
    "simulate gone.toml",
    "simulate in/demo/satellites.tle",
    "simulate in/demo/pass.toml -o x.jpg",
    "simulate in/demo/pass.toml -o x.html",
    "simulate in/demo/pass.toml --step-s -1",
    "simulate in/demo/pass.toml --step-s 0",
    "simulate in/demo/pass.toml --from 2020-11-18T17:25:00",
    "simulate in/demo/pass.toml --from soon",
    "simulate in/demo/pass.toml --tolerance 0",
    "simulate in/demo/pass.toml --tolerance much",
    "simulate in/demo/pass.toml --laser debris",
    "simulate in/demo/pass.toml --active",
    "simulate in/demo/pass.toml --station nowhere",
    "simulate in/demo/pass.toml -o nowhere/p.ecsv",
    f"simulate {SCENES}/active.toml --active --laser debri",
)
refused("explain", "explain", "explain gone.toml", "explain in/demo/pass.toml --tolerance 200%", "explain in/demo/pass.toml --tolerance nan", "explain in/demo/pass.toml -o e.png", "explain in/demo/night.toml", "explain in/demo/satellites.tle")
PASS = "in/demo/pass.toml"
for name, old, new in [
    ("unknown_key", "period_s = 120.0", "periods_s = 120.0"),
    ("unknown_table", "[times]", "[timse]"),
    ("unknown_target", '"box_wing"', '"box_wings"'),
    ("unknown_law", 'law = "spin"', 'law = "spinn"'),
    ("bad_number", "step_s = 0.5", 'step_s = "0.5"'),
    ("negative", "period_s = 120.0", "period_s = 0"),
    ("bad_elements", "13\",", "14\","),
    ("bad_time", "2020-11-18T16:22:00", "2020-11-31T16:22:00"),
    ("backwards", "2020-11-18T16:22:00", "2020-11-18T16:32:00"),
    ("no_toml", "[orbit]", "[orbit"),
    ("no_station", 'name = "ufo"', 'name = "uff"'),
    ("two_keys", "step_s = 0.5", "step_s = 0.5\nstep_s = 1"),
    ("bad_lines", "1 99004U", "3 99004U"),
]:
    case(f"simulate/wrong_{name}", "simulate pass.toml", "explain pass.toml", edit={"pass.toml": (PASS, [(old, new)])})
TARGET = "in/scenes/dish_and_wing.toml"
for name, old, new in [
    ("shape", 'shape = "dish"', 'shape = "disc"'),
    ("material", 'material = "white"                #', 'material = "whit"  #'),
    ("size", "size_m = [1, 1, 2]", "size_m = [1, 1]"),
    ("hinge", 'hinge = "boom"', 'hinge = "bom"'),
    ("reflectance", "reflectance = 0.1", "reflectance = 1.1"),
    ("model", 'model = "lambert"', 'model = "lamber"'),
    ("mesh", 'shape = "box"\nsize_m = [1, 1, 2]', 'shape = "mesh"\nfile = "gone.obj"'),
]:
    case(
        f"simulate/target_{name}",
        "simulate dish_and_wing.toml",
        "picture --model target.toml",
        copy=[TARGET],
        edit={"target.toml": ("in/scenes/target.toml", [(old, new)])},
    )

# --- compare ----------------------------------------------------------------------------------------------------------------------------------------------

SPHERE = "compare in/demo/sphere.ecsv in/demo/sphere.toml"
formats("compare/sphere", SPHERE, "c", "ecsv", "csv", "fits", "json", "png", "svg", "html")
case("compare/box_wing", "compare in/demo/box_wing.ecsv pass.toml --tolerance 1% -o out/ --json", edit={"pass.toml": (PASS, [("16:30:00", "16:23:30")])})
case(
    "compare/options",
    f"{SPHERE} --channel spcm --channel mppc -o counters/",
    f"{SPHERE} --channel g --tolerance 0.5% -v",
    f"{SPHERE} -q",
    f"{SPHERE} -o -",
    "compare in/curves/magnitudes.csv in/demo/sphere.toml --sigma-column sigma",
    *[f"compare in/curves/magnitudes.csv in/demo/sphere.toml --as {kind} --json" for kind in ["apparent", "ground", "1000km", "standard"]],
    "compare in/curves/magnitudes.csv in/demo/sphere.toml --column magnitude -o m.html -o m.svg -o m.ecsv",
    f"{SPHERE} --column v",
)
refused(
    "compare",
    "compare",
    "compare in/demo/sphere.ecsv",
    "compare gone.ecsv in/demo/sphere.toml",
    "compare in/demo/sphere.ecsv gone.toml",
    "compare in/demo/reduced/sphere_1.ecsv in/demo/sphere.toml",
    "compare in/demo/sphere.ecsv in/demo/pass.toml",
    f"{SPHERE} --channel nir",
    f"{SPHERE} --column",
    f"{SPHERE} -o x.pdf",
    f"{SPHERE} -o nowhere/x.html",
    f"{SPHERE} --station in/six_bands",
    f"{SPHERE} --tolerance 2",
    "compare in/curves/magnitudes.csv in/demo/sphere.toml --column v",
    "compare in/curves/magnitudes.csv in/demo/sphere.toml --as absolute",
    "compare in/demo/sphere.toml in/demo/sphere.ecsv",
    "compare in/sims/sphere_pass.ecsv in/scenes/sphere_pass.toml",
)

# --- picture ----------------------------------------------------------------------------------------------------------------------------------------------

SMALL = "--size-px 64"
formats("picture/pass", f"picture {PASS} {SMALL}", "p", "fits", "png", "svg", "json")
formats("picture/map", "picture --model box_wing --map --step-deg 15 --phase 20 --per-irradiance", "m", "fits", "png", "svg", "json")
formats("picture/sphere", "picture --sphere --alpha 0.05,0.2,1", "s", "ecsv", "csv", "fits", "json", "png", "svg")
case(
    "picture/options",
    f"picture {PASS} --at 2020-11-18T16:24:30 --what intensity --wavelength-nm 450,650,850 {SMALL} -o bands.png -o bands.fits",
    f"picture {PASS} --station-optics --what intensity -o camera.png -o camera.fits --seeing-arcsec 1.5",
    f"picture --model box_wing --phase 70 --observer 1,-0.4,0.3 {SMALL} -o box_wing.png",
    f"picture --model box_wing --sun 1,0,0.2 --observer 1,-0.4,0.3 --up body-z {SMALL} --what material --json",
    f"picture {PASS} {SMALL} --up zenith --what depth -o depth.fits",
    f"picture {PASS} {SMALL} --up north --what rgb -o rgb.png",
    f"picture --model corner --range-km 500 --psf-arcsec 0.5 --pixel-m 0.05 {SMALL} --what intensity -o corner.fits --json",
    f"picture --model {SCENES}/target.toml {SMALL} --phase 30 -o target.png -v",
    "picture --model in/scenes/materials.toml --map --step-deg 30 --json --wavelength-nm 500,700",
    "picture --sphere",
)
refused(
    "picture",
    "picture",
    "picture gone.toml",
    "picture --model box_wings",
    f"picture {PASS} --phase 30",
    "picture --model box_wing --phase 70 --sun 1,0,0.2",
    f"picture {PASS} --model box_wing",
    "picture --model box_wing --up north",
    "picture --model box_wing --psf-arcsec 1",
    "picture --model box_wing --size-px 0",
    "picture --model box_wing --size-px 100000",
    "picture --model box_wing --phase 200",
    "picture --model box_wing --observer 0,0,0",
    "picture --model box_wing --observer 1,2",
    "picture --model box_wing --what heat",
    "picture --model box_wing --what intensity --wavelength-nm 100",
    "picture --model box_wing --map --step-deg 0",
    "picture --model box_wing --map -o m.ecsv",
    "picture --sphere --alpha 0",
    "picture --sphere --alpha x",
    f"picture {PASS} --at 2020-11-18T10:24:30",
    f"picture {PASS} -o p.html",
)

# --- passes -----------------------------------------------------------------------------------------------------------------------------------------------

TLE = "passes --tle in/fixtures/passes/satellites.tle --station ufo --from 2024-08-12T18:00 --to 2024-08-13T04:00"
DEMO = "passes --tle in/demo/satellites.tle --station ufo --from 2020-11-18T15:00:00 --to 2020-11-19T06:00:00"
formats("passes", f"{TLE} --norad 90001,90002,90004,90005", "p", "ecsv", "csv", "fits", "json", "png", "svg")
formats("passes/demo", f"{DEMO} --min-culmination 40", "p", "ecsv", "png")
case(
    "passes/options",
    f"{TLE} --name leo --limit 3 --standard-magnitude 4",
    f"{TLE} --norad 90002 --diameter-m 2 --reflectance 1 --exposure-s 1 --zero-point ab --json",
    f"{TLE} --brighter-than 5 --min-duration-s 240 --sun-below -12 --min-elevation 30 -v",
    f"{TLE} --norad 90002 --brighter-than -9",
    f"{TLE} --norad 90008",
    f"{TLE} --aerosol rural_5km --profile midlatitude_summer --water-mm 20 --ozone-du 300 --limit 2",
    f"{DEMO} --norad 99004 --model box_wing --attitude in/demo/pass.toml --tolerance 5%",
    f"{DEMO} --norad 99004 --model lambert_sphere --json",
    f"{DEMO} --name 'DUSK 90' --model box_wing_diffuse --attitude yaw_steering --tolerance 5% -o t.ecsv",
    f"{TLE} --norad 90002 -o - -q",
    "passes --tle in/demo/satellites.tle --tle in/fixtures/passes/satellites.tle --station in/fixtures/passes/mmt9 --from 2020-11-18 --limit 5",
    "passes --tle in/fixtures/orbits/SGP4-VER.TLE --station ufo --from 2006-06-20 --to 2006-06-21 --limit 10",
    f"{DEMO} --limit 3 --threads 1",
)
refused(
    "passes",
    "passes",
    "passes --tle missing.tle --station ufo",
    "passes --tle empty.tle --station ufo",
    "passes --tle in/demo/pass.toml --station ufo --from 2020-11-18 --to 2020-11-19",
    "passes --tle in/demo/satellites.tle --station ufo --from 2024-08-12 --to 2024-08-11",
    f"{TLE} --norad 12345",
    f"{TLE} --norad x",
    f"{TLE} --name nothing",
    f"{TLE} --diameter-m 0",
    f"{TLE} --reflectance 1.5",
    f"{TLE} --exposure-s -1",
    f"{TLE} --min-elevation 95",
    f"{TLE} --min-duration-s nan",
    f"{TLE} --brighter-than inf",
    f"{TLE} -o sky.txt",
    f"{TLE} --standard-magnitude 4 --diameter-m 2",
    f"{TLE} --model box_wings",
    f"{TLE} --model box_wing --attitude orbits",
    f"{TLE} --model box_wing --attitude spin",
    f"{TLE} --attitude orbit",
    write={"empty.tle": ""},
)
case("passes/wrong_checksum", "passes --tle some.tle --station ufo --from 2020-11-18T16:00 --to 2020-11-18T18:00", "passes --tle some.tle --station ufo --from 2020-11-18T16:00 --to 2020-11-18T18:00 --json -q", edit={"some.tle": ("in/demo/satellites.tle", [("14.27000000    13", "14.27000000    14")])})

# --- reduce, align, session, observe ----------------------------------------------------------------------------------------------------------------------

NIGHT = "in/fixtures/nights/2020-11-18_synthetic"
SHORT = "in/night/short"
FRAMES = [f"{SHORT}/frames/cam/17/20201118T1700{2 * i:02}.000000Z_{i + 1:08}.fits" for i in range(16)]
DARK, FLAT = " ".join(FRAMES[:3]), " ".join(FRAMES[8:11])
formats("reduce/short", f"reduce {SHORT}", "r", "ecsv", "csv", "fits", "json")
case("reduce/raw", f"reduce {SHORT} --raw -o out/ --json")
case("reduce/night", f"reduce {NIGHT} -o out/", slow=True)
case("reduce/night_text", f"reduce {NIGHT}", f"reduce {NIGHT} --json")
case("reduce/demo", "reduce in/demo/session")
case(
    "reduce/options",
    f"reduce {SHORT} --gate none --no-coupling -v",
    f"reduce {SHORT} --gate 2 --off-sigma 0 --aperture-px 6 --annulus-px 10 20 --json",
    f"reduce {SHORT} --fwhm-px 4 --max-offset-px 40 --detect-sigma 8 --brightest",
    f"reduce {SHORT} --trailed --json",
    f"reduce {NIGHT} --target 'mu And' -o one/",
    f"reduce {NIGHT} --target box_wing_pass --station ufo --json",
    f"reduce {SHORT} -q -o short/",
)
case("reduce/live_tags", "reduce in/night/live", "reduce in/night/live --json", "reduce in/night/live --raw -o out/ -q")
case("reduce/dark_and_flat", f"reduce {SHORT} --dark {DARK} --flat {FLAT} --json", f"reduce {SHORT} --dark {DARK}", f"align {SHORT} --dark {DARK} --flat {FLAT}")
case("reduce/cut", "reduce in/cut_session", "reduce in/cut_session --json")
refused(
    "reduce",
    "reduce",
    "reduce gone",
    "reduce in/demo",
    "reduce in/demo/pass.toml",
    f"reduce {SHORT} --target Betelgeuze",
    f"reduce {SHORT} --raw",
    f"reduce {SHORT} --gate x",
    f"reduce {SHORT} --gate -1",
    f"reduce {SHORT} --aperture-px 0",
    f"reduce {SHORT} --annulus-px 20 10",
    f"reduce {SHORT} --annulus-px 20",
    f"reduce {SHORT} --dark gone.fits",
    f"reduce {SHORT} --dark in/fixtures/formats/hostile/cut_off.fits",
    f"reduce {SHORT} --fibre in/lab/run.toml",
    f"reduce {SHORT} --station in/six_bands",
    f"reduce {SHORT} --station nowhere",
    f"reduce {SHORT} -o x.pdf",
)
formats("align", f"align {SHORT} --fibre-out fibre.toml", "a", "ecsv", "csv", "fits", "json", "png", "svg")
case("align/then_reduce", f"align {SHORT} --fibre-out fibre.toml -q", f"reduce {SHORT} --fibre fibre.toml", f"align {SHORT} --fibre-out fibre.toml")
case("align/options", f"align {SHORT} --rotation --cell-px 8 -o f/", f"align {SHORT} {NIGHT} --json", f"align {SHORT} --aperture-px 6 --annulus-px 10 20 --fwhm-px 4 --max-offset-px 60 --detect-sigma 8 --brightest --trailed", f"align in/demo/session -v")
refused(
    "align",
    "align",
    "align gone",
    "align in/demo",
    f"align {SHORT} --cell-px 0",
    f"align {SHORT} --fibre-out nowhere/f.toml",
    f"align {SHORT} --station in/six_bands",
    f"align {SHORT} --target Vega",
    f"align {SHORT} -o a.pdf",
    "align in/night/live",
    f"align {SHORT} {SHORT}",
)
case("session/check", f"session check {NIGHT}", f"session check {NIGHT} --json", "session check in/demo/session", f"session check {SHORT} -v", f"session check {SHORT} -q", "session check in/night/live --json")
case("session/cut", "session check in/cut_session", "session check in/cut_session --json")
refused("session", "session check", "session check gone", "session check in/demo", "session check in/demo/pass.toml", "session chek in/demo/session")
case("observe/virtual", "observe short.toml -o s", "session check s", "reduce s --json", "observe short.toml -o s", "observe short.toml -q -o deep/s", copy=["in/night/short.toml", "in/night/short_virtual.toml"])
case("observe/default_name", "observe short.toml", "observe short.toml", "observe short.toml --json", copy=["in/night/short.toml", "in/night/short_virtual.toml"])
case("observe/seed", "observe short.toml -o s --seed 3", copy=["in/night/short.toml", "in/night/short_virtual.toml"])
case("observe/replay", f"observe --replay {SHORT} --fast -o s", "session check s --json", "reduce s --json", f"observe --replay {NIGHT} --fast -o n --json --every 60", "session check n")
case("observe/replay_tags", "observe --replay in/night/live --fast -o s", "session check s --json", "reduce s --json")
case("observe/demo_plan", "observe in/demo/night.toml -o s", "session check s", slow=True)
case("observe/live_stopped", "observe live.toml -o s --every 60", copy=["in/night/live.toml"], interrupt_s=1.5, tries=4)
case("observe/live", "observe live.toml -o s --every 1", "session check s", "observe live.toml -o t --json --every 1", copy=["in/night/live.toml"], tries=4)
refused(
    "observe",
    "observe",
    "observe gone.toml",
    "observe in/demo/pass.toml",
    "observe --replay gone",
    "observe --replay in/demo",
    "observe --fast",
    "observe in/night/short.toml --replay in/night/short",
    "observe in/night/short.toml -o s --every 0",
    "observe in/night/short.toml -o nowhere/s",
    "observe in/night/short.toml -o in/lab/run.toml",
)
for name, old, new in [
    ("unknown_key", "exposure_s = 0.2", "exposures_s = 0.2"),
    ("bad_device", 'device = "virtual"', 'device = "virtul"'),
    ("real_device", 'device = "virtual"', 'device = "sim-camera"'),
    ("negative", "bin_s = 0.1", "bin_s = -0.1"),
    ("two_inputs", "spcm = 2", "spcm = 1"),
    ("no_station", 'station = "ufo"', 'station = "uff"'),
    ("no_virtual", '"short_virtual.toml"', '"gone.toml"'),
    ("window", "[595, 419, 200, 200]", "[1395, 419, 200, 200]"),
    ("raw_tags", "bin_s = 0.1", "bin_s = 0.1\nraw_tags = true"),
    ("name", 'name = "tagger"', 'name = "ta/gger"'),
    ("channel", "spcm = 2", "spc = 2"),
]:
    case(f"observe/wrong_{name}", "observe short.toml -o s", edit={"short.toml": ("in/night/short.toml", [(old, new)])}, copy=["in/night/short_virtual.toml"])
for name, old, new in [("key", "seed = 5", "sed = 5"), ("value", "stars = 2", "stars = -2"), ("range", "v_mag = [2.5, 4.5]", "v_mag = [4.5, 2.5]"), ("none", "v_mag = [2.5, 4.5]", "v_mag = [-9, -8]")]:
    case(f"observe/virtual_{name}", "observe short.toml -o s", copy=["in/night/short.toml"], edit={"short_virtual.toml": ("in/night/short_virtual.toml", [(old, new)])})

# --- calibrate, apply -------------------------------------------------------------------------------------------------------------------------------------

formats("calibrate", "calibrate in/demo/reduced --station ufo", "k", "ecsv", "csv", "fits", "json", "png", "svg")
case("calibrate/nights", "calibrate in/linear in/linear_next --station ufo -o k.ecsv -o k.png", "calibrate in/linear in/linear_next --station ufo --json", "calibrate in/linear/summary.ecsv --station ufo")
case("calibrate/session", f"calibrate {NIGHT} --station ufo", f"calibrate {NIGHT} --station ufo --json")
case(
    "calibrate/options",
    "calibrate in/demo/reduced --station ufo --floor 0.05 --clip-sigma 3 --confidence 0.9",
    "calibrate in/demo/reduced --station ufo --seed 7 --json",
    "calibrate in/demo/reduced --station ufo --fit-aerosol --aerosol 0,0",
    "calibrate hazy --station ufo --fit-aerosol --aerosol 0,1.1 -o k.ecsv -o k.png",
    "calibrate in/demo/reduced --station ufo --scintillation 0 --zero-point ab -v",
    "calibrate in/demo/reduced --station ufo --aerosol rural_23km -q",
    "calibrate in/demo/reduced in/demo/reduced --station ufo",
    copy=["in/hazy"],
)
refused(
    "calibrate",
    "calibrate",
    "calibrate gone --station ufo",
    "calibrate in/demo/reduced",
    "calibrate in/demo/reduced --station in/six_bands",
    "calibrate in/demo/kappa.ecsv --station ufo",
    "calibrate in/lab --station ufo",
    "calibrate empty --station ufo",
    "calibrate in/demo/sphere.ecsv --station ufo",
    "calibrate in/demo/reduced --station ufo --floor -1",
    "calibrate in/demo/reduced --station ufo --confidence 1",
    "calibrate in/demo/reduced --station ufo --clip-sigma 0",
    "calibrate in/demo/reduced --station ufo --scintillation x",
    "calibrate in/demo/reduced --station ufo -o k.pdf",
    f"calibrate {SHORT} --station ufo",
    write={"empty": None},
)
APPLY = "apply in/kappa.ecsv in/demo/reduced/sphere_1.ecsv --station ufo"
formats("apply", f"{APPLY} --magnitudes V --photometry-out m.ecsv", "c", "ecsv", "csv", "fits", "json", "png", "svg")
case(
    "apply/options",
    f"{APPLY} --magnitudes V --phase-law illuminated --json",
    f"{APPLY} --magnitudes I --zero-point ab --photometry-out p.fits --photometry-out p.csv",
    f"{APPLY} --spectrum vega.csv --magnitudes V -v",
    f"{APPLY} --spectrum G2V --magnitudes B --json",
    f"{APPLY} -o - -q",
    "apply in/kappa_two.ecsv in/linear_next/box_wing_pass_1.ecsv --station ufo --night 2020-11-18",
    "apply in/kappa_two.ecsv in/linear_next/box_wing_pass_1.ecsv --station ufo --json",
    "apply in/kappa_two.ecsv in/demo/reduced/sphere_1.ecsv --station ufo --aerosol none",
    "apply in/kappa.ecsv in/demo/reduced/box_wing_1.ecsv --station ufo -o b.ecsv -o b.png",
    "apply in/kappa.ecsv in/demo/reduced/sphere_1.ecsv --station in/six_bands",
    copy=["in/lab/responsivity.csv"],
    write={"vega.csv": "wavelength_nm,irradiance_w_m2_nm\n300,1e-11\n550,4e-11\n1240,1e-11\n"},
)
refused(
    "apply",
    "apply",
    "apply in/kappa.ecsv",
    "apply gone.ecsv in/demo/reduced/sphere_1.ecsv --station ufo",
    "apply in/kappa.ecsv gone.ecsv --station ufo",
    "apply in/demo/sphere.ecsv in/demo/sphere.ecsv --station ufo",
    "apply in/kappa.ecsv in/demo/sphere.ecsv --station ufo",
    "apply in/kappa.ecsv in/curves/turning_linear.ecsv --station ufo",
    f"{APPLY} --night 2020-11-19",
    f"{APPLY} --night yesterday",
    f"{APPLY} --magnitudes Q",
    f"{APPLY} --magnitudes Gaia_G",
    f"{APPLY} --spectrum bright",
    f"{APPLY} --photometry-out p.ecsv",
    f"{APPLY} --magnitudes V --photometry-out p.pdf",
    f"{APPLY} -o c.pdf",
    "apply in/kappa.ecsv in/demo/reduced/sphere_1.ecsv --station nowhere",
    "apply in/kappa.ecsv in/demo/reduced/sphere_1.ecsv",
)

# --- fit --------------------------------------------------------------------------------------------------------------------------------------------------

FIT = "fit in/sims/fit_sphere.ecsv in/scenes/fit_sphere.toml"
formats("fit/sphere", FIT, "f", "ecsv", "csv", "json", "png", "svg", "html")
case("fit/measured", "fit in/demo/sphere.ecsv in/demo/sphere.toml -o found/", "fit in/demo/sphere.ecsv in/demo/sphere.toml --json --scene-out s.toml", "simulate s.toml --json")
case(
    "fit/options",
    *[f"{FIT} --loss {loss} --json" for loss in ["squares", "huber", "student", "tukey"]],
    f"{FIT} --free extinction --free gain --channel g --channel spcm",
    f"{FIT} --free time_offset_s=-1..1 --places 16 --starts 2 --seed 4 --json",
    f"{FIT} --free size=0.5..2 --places 8 --starts 1 --channel g -v",
    f"{FIT} --scintillation 0 --iterations 10 -q",
    f"{FIT} --station ufo --channel g --json",
    "fit in/curves/magnitudes.csv in/demo/sphere.toml --magnitudes-as apparent --sigma-mag 0.05",
    "fit in/curves/magnitudes.csv in/demo/sphere.toml --magnitude-column magnitude --scintillation 0 --json",
    "fit in/curves/ranged.csv in/demo/sphere.toml --magnitudes-as 1000km --free albedo -o m.ecsv -o m.html",
    "fit in/curves/ranged.csv in/demo/sphere.toml --magnitudes-as standard --free albedo --json",
    "fit in/demo/sphere.ecsv in/curves/magnitudes.csv in/demo/sphere.toml --free gain --per-pass gain --json",
    "fit in/sims/fit_sphere.ecsv in/scenes/fit_sphere.toml in/demo/sphere.ecsv in/demo/sphere.toml --free albedo -o two/",
)
case("fit/corner", "fit in/sims/corner.ecsv in/scenes/corner.toml --free albedo --json")
case("fit/box_wing", "fit in/sims/turning.ecsv in/scenes/turning.toml --free scale.white --free scale.mli --channel g --channel spcm --free attitude.phase_deg=30..50 --places 4 --starts 1 -o b/ --json")
case("fit/not_converged", f"{FIT} --free size=0.5..2 --free time_offset_s=-2..2 --places 4 --starts 1 --channel g --iterations 0 -o short/")
refused(
    "fit",
    "fit",
    "fit in/sims/fit_sphere.ecsv",
    "fit gone.ecsv in/scenes/fit_sphere.toml",
    "fit in/sims/fit_sphere.ecsv gone.toml",
    "fit in/scenes/fit_sphere.toml in/sims/fit_sphere.ecsv",
    "fit in/demo/reduced/sphere_1.ecsv in/demo/sphere.toml",
    f"{FIT} --free nothing",
    f"{FIT} --free albedos",
    f"{FIT} --free material.surface.alfa",
    f"{FIT} --free gain=2..1",
    f"{FIT} --free gain=x",
    f"{FIT} --channel violet",
    f"{FIT} --loss sum",
    f"{FIT} --places x",
    "fit in/curves/magnitudes.csv in/demo/sphere.toml --magnitudes-as standard",
    f"{FIT} --per-pass gain",
    f"{FIT} -o f.pdf",
    f"{FIT} --scene-out nowhere/s.toml",
    "fit in/curves/magnitudes.csv in/demo/sphere.toml --magnitude-column v",
    "fit in/demo/sphere.ecsv in/demo/pass.toml",
    "fit in/sims/fit_sphere.ecsv in/scenes/one.toml",
)

# --- analyse ----------------------------------------------------------------------------------------------------------------------------------------------

SIX = "in/sims/six/box_wing_pass.ecsv"
TURNING = "in/curves/turning_linear.ecsv"
formats("analyse/fold", f"analyse fold {TURNING} --station ufo --period 20 --period-sigma 0.01", "f", "ecsv", "csv", "fits", "json", "png", "svg")
case(
    "analyse/fold_options",
    f"analyse fold {SIX} --station in/six_bands --period 120 --keep air --keep range --keep phase --channel g854 --bins 20",
    f"analyse fold {SIX} --station in/six_bands --period 120 --pass in/demo/pass.toml --axis 161.565,71.589 --json",
    f"analyse fold {TURNING} --station ufo --period 20 --epoch 2008-09-21T18:46:00",
    "analyze fold in/curves/track.txt --period 7.3 --json",
    "analyse fold in/curves/track.csv --period 7.3 --magnitudes-as 1000km --magnitude-column magnitude --sigma-mag 0.05 -o t.png",
)
formats("analyse/period", f"analyse period {TURNING} --station ufo", "p", "ecsv", "csv", "fits", "json", "png", "svg")
case(
    "analyse/period_options",
    "analyse period in/curves/track.txt",
    "analyse period in/curves/track.csv --shortest 2 --longest 30 --harmonics 3 --json",
    "analyse period in/curves/track.csv --magnitudes-as standard --sigma-mag 0.1 --shortest 5 --longest 12",
    "analyse period in/curves/tracks.csv --gap 600",
    "analyse period in/curves/flat.ecsv --station ufo",
    f"analyse period {TURNING} in/curves/turning_predicted.ecsv --station ufo --json",
    f"analyse period {TURNING} --station ufo --pass in/scenes/sphere_pass.toml",
)
case("analyse/period_pass", f"analyse period {SIX} --station in/six_bands --pass in/demo/pass.toml --json", slow=True)
UNMIX = "analyse unmix in/sims/six/box_wing_pass.ecsv --station in/six_bands"
formats("analyse/unmix", f"{UNMIX} --endmembers white,mli,solar_cell", "u", "ecsv", "csv", "fits", "json", "png", "svg")
case(
    "analyse/unmix_options",
    "analyse unmix in/sims/sphere_pass.ecsv --endmembers white,solar_cell,mli --station ufo --unweighted",
    "analyse unmix in/sims/spinning.ecsv --endmembers white,mli --pass in/scenes/spinning.toml --total 0.3 --json",
    "analyse unmix in/sims/sphere_pass_spectra.fits --endmembers aluminium,solar_cell,mli,white -o m.ecsv",
    f"{UNMIX} --endmembers box_wing --json",
    "analyse unmix in/sims/turning.ecsv --endmembers box_wing --pass in/scenes/turning.toml --confusion -o c/",
    "analyse unmix in/sims/sphere_pass.ecsv --endmembers white,white --station ufo",
    "analyse unmix in/sims/sphere_pass.ecsv --endmembers white --no-air --station ufo -v",
)
formats("analyse/endmembers", "analyse endmembers in/sims/turning_spectra.fits --against box_wing --noise 1e-3", "e", "ecsv", "csv", "fits", "json", "png", "svg")
case("analyse/endmembers_options", "analyse endmembers in/sims/turning.ecsv --against white,mli --pass in/scenes/turning.toml --most 3", "analyse endmembers in/sims/turning_spectra.fits --noise 1e-3 -o found.ecsv -q", "analyse unmix in/sims/turning_spectra.fits --endmembers found.ecsv --json")
formats("analyse/map", "analyse map in/scenes/spinning.toml --step-deg 15 --along", "m", "fits", "json", "png", "svg")
case(
    "analyse/map_options",
    "analyse map in/scenes/turning.toml --step-deg 30 --phase 30 --endmembers box_wing --ranges-nm 1064 -o r/",
    "analyse map in/scenes/spinning.toml --station in/six_bands --step-deg 30",
    "analyse map in/scenes/spinning.toml --curve in/sims/spinning.ecsv --endmembers white,mli --step-deg 15 -o s/ --json",
    "analyse map in/scenes/turning.toml --curve in/sims/turning.ecsv --step-deg 20 -o placed.fits",
    "analyse map in/scenes/spinning.toml --curve in/curves/turning_predicted.ecsv --quality --period 20 --axes-deg 45 -o q/",
    "analyse map in/scenes/spinning.toml --curve in/curves/turning_predicted.ecsv --quality --period 20 --axes-deg 60 --within-percent 2 --json",
)
ATTITUDE = "analyse attitude in/sims/turning.ecsv in/scenes/turning.toml"
case("analyse/attitude_known", f"{ATTITUDE} --known axis,period --json", f"{ATTITUDE} --known axis --period 60..80 --sense right --scale grey -o out/", f"{ATTITUDE} --known axis,phase --period 60..80 --channel g --scale channel")
case("analyse/attitude", f"{ATTITUDE} --period 60..80 --sense right --axes 60 --direct-only -o out/ --json --scene-out s.toml", slow=True)
case(
    "analyse/attitude_magnitudes",
    "analyse attitude magnitudes.csv in/scenes/turning.toml --known axis --period 60..80 --scale grey --sigma-mag 0.05 --magnitude-column magnitude --magnitudes-as apparent --direct-only --json --station ufo",
    copy=["in/curves/turned/magnitudes.csv"],
)
case("analyse/attitude_checkpoint", f"{ATTITUDE} --period 60..80 --sense right --axes 40 --direct-only --scale grey --checkpoint c.json -o a.ecsv", f"{ATTITUDE} --period 60..80 --sense right --axes 40 --direct-only -q -o a.ecsv", f"{ATTITUDE} --known axis --period 60..80 -o a.ecsv --force -q", slow=True)
refused(
    "analyse/fold",
    "analyse fold",
    "analyse fold gone.ecsv --period 20",
    f"analyse fold {TURNING} --station ufo",
    f"analyse fold {TURNING} --station ufo --period -2",
    f"analyse fold {TURNING} --station ufo --period 20 --bins 0",
    f"analyse fold {TURNING} --station ufo --period 20 --axis 1,95 --pass in/scenes/sphere_pass.toml",
    f"analyse fold {TURNING} --station ufo --period 20 --channel x",
    f"analyse fold {TURNING} --station ufo --period 20 --keep light",
    f"analyse fold {TURNING} --station ufo --period 20 -o f.pdf",
    "analyse fold in/demo/pass.toml --period 20",
)
refused(
    "analyse/period",
    "analyse period",
    "analyse period gone.ecsv",
    "analyse period in/demo/pass.toml",
    f"analyse period {TURNING} --station ufo --shortest 0",
    f"analyse period {TURNING} --station ufo --shortest 30 --longest 20",
    f"analyse period {TURNING} --station ufo --channel g53",
    f"analyse period {TURNING} --station ufo --harmonics 0",
    "analyse period in/curves/track.csv --magnitude-column mag",
    "analyse period in/curves/tracks.csv --gap 0",
    "analyse period in/fixtures/formats/hostile/nan.csv",
)
refused(
    "analyse/unmix",
    "analyse unmix",
    f"{UNMIX}",
    f"{UNMIX} --endmembers whit",
    f"{UNMIX} --endmembers gone.csv",
    f"{UNMIX} --endmembers white,unit,grey80",
    "analyse unmix gone.ecsv --endmembers white --station ufo",
    f"analyse unmix {TURNING} --endmembers white --station ufo",
    "analyse unmix in/sims/sphere_pass.ecsv --endmembers white --confusion",
    "analyse unmix in/sims/sphere_pass.ecsv --endmembers white --pass in/scenes/sphere_pass.toml --confusion --total -1",
    "analyse unmix in/fixtures/formats/hostile/no_groups.fits --endmembers white",
)
refused(
    "analyse/map",
    "analyse map",
    "analyse map gone.toml",
    "analyse map in/scenes/sphere_pass.toml",
    "analyse map in/scenes/spinning.toml -o m.ecsv",
    "analyse map in/scenes/spinning.toml --phase 180",
    "analyse map in/scenes/turning.toml --curve in/curves/turning_predicted.ecsv",
    "analyse map in/scenes/spinning.toml --step-deg 0",
    "analyse map in/scenes/spinning.toml --quality --period 5",
    "analyse map in/scenes/spinning.toml --curve in/curves/turning_predicted.ecsv --quality",
    "analyse map in/scenes/spinning.toml --curve in/curves/turning_predicted.ecsv --quality --period 0",
    "analyse map in/scenes/spinning.toml --curve in/curves/turning_predicted.ecsv --quality --period 5 --within-percent 60",
    "analyse map in/scenes/spinning.toml --curve in/curves/turning_linear.ecsv",
)
refused(
    "analyse/attitude",
    "analyse attitude",
    "analyse attitude in/sims/turning.ecsv",
    "analyse attitude gone.ecsv in/scenes/turning.toml",
    "analyse attitude in/scenes/turning.toml in/sims/turning.ecsv",
    f"{ATTITUDE} --period 9..2",
    f"{ATTITUDE} --period 0.001..",
    f"{ATTITUDE} --known axis,phase,period",
    f"{ATTITUDE} --known period --sense left",
    f"{ATTITUDE} --channel violet",
    f"{ATTITUDE} --checkpoint c.json",
    f"{ATTITUDE} --scale sum",
    f"{ATTITUDE} --axes 0",
    "analyse attitude in/sims/sphere_pass.ecsv in/scenes/sphere_pass.toml",
    "analyse attitude in/sims/fit_sphere.ecsv in/scenes/fit_sphere.toml",
    write={"c.json": "{}"},
)
refused("analyse/endmembers", "analyse endmembers", "analyse endmembers gone.ecsv", "analyse endmembers in/sims/turning_spectra.fits --noise 1.5", "analyse endmembers in/sims/turning_spectra.fits --most 0", "analyse endmembers in/sims/turning_spectra.fits --against whit", f"analyse endmembers {TURNING} --station ufo")

# --- brdf, efficiency -------------------------------------------------------------------------------------------------------------------------------------

case("brdf/retro", "brdf retro run.toml -o lab/ --yes", "brdf retro run.toml --yes --json -o again/", "brdf retro run.toml -o lab/ --reduce", "brdf retro run.toml -o lab/ --yes", copy=["in/lab/run.toml", "in/lab/rig.toml"])
case("brdf/retro_again", "brdf retro run.toml --yes -o lab/ -q --seed 4", "brdf retro run.toml -o lab/ --resume --yes", "brdf retro run.toml -o lab/ --incident --resume --yes --force", "brdf retro run.toml -o lab/ --reduce --force", copy=["in/lab/run.toml", "in/lab/rig.toml"])
UNPLUGGED = ("in/lab/rig.toml", [("seed = 1", "seed = 1\n[fault]\nunplugged_at_reading = 900\n")])
case(
    "brdf/retro_resume",
    "brdf retro run.toml -o lab/ --yes",
    "brdf retro run.toml -o lab/ --reduce",
    "brdf retro run.toml -o lab/ --resume --yes --json --force",
    copy=["in/lab/run.toml"],
    edit={"rig.toml": UNPLUGGED},
)
case("brdf/retro_asks", "brdf retro run.toml -o lab/", copy=["in/lab/run.toml", "in/lab/rig.toml"], stdin="\n\n\n\n\n\n")
RETRO = "in/lab/retro/retro.ecsv"
formats("brdf/ndf", f"brdf ndf {RETRO} --resamplings 10", "n", "ecsv", "csv", "fits", "json", "png", "svg")
case(
    "brdf/ndf_options",
    f"brdf ndf {RETRO} --resamplings 5 --seed 5 --json",
    f"brdf ndf {RETRO} --resamplings 0 --zero-deg 0.7 --median 3 --elevations 64",
    *[f"brdf ndf {RETRO} --resamplings 0 --tail {tail}" for tail in ["ggx", "beckmann", "exponential", "linear"]],
    f"brdf ndf {RETRO} --resamplings 3 --most-offset-deg 2 -v",
    "brdf ndf in/lab/anisotropic.csv --resamplings 2 -o a/",
    "brdf ndf in/lab/anisotropic.csv --resamplings 0 --elevations 24 --azimuths 32 --json",
)
NDF = "in/lab/ndf/ndf.ecsv"
formats("brdf/plan", f"brdf plan {NDF} --side 9", "p", "ecsv", "csv", "fits", "json", "png", "svg")
case(
    "brdf/plan_options",
    f"brdf plan {NDF} --rig --side 9 -o rig/",
    f"brdf plan {NDF} --rig --most-theta-i-deg 50 --most-theta-o-deg 70 --least-phase-deg 20 --mark-deg 2 --side 17 --theta-i 6 --json",
    f"brdf plan {NDF} --side 8 --wide 0 --normals 64",
    "brdf plan in/lab/anisotropic/ndf.ecsv --side 5 --theta-i 3 --phi-i 4 --normals 32 --quarter --json",
)
case("brdf/plan_budget", f"brdf plan {NDF} --measurements 40 -o few/", f"brdf plan {NDF} --hours 0.3 --json")
formats("brdf/ingest", "brdf ingest in/lab/ingest.toml", "s", "ecsv", "csv", "fits", "json", "png", "svg")
SAMPLES = "in/lab/samples/samples.ecsv"
ASSEMBLE = f"brdf assemble {SAMPLES} {NDF} --side 9 --theta-i 4 --normals 32"
case("brdf/assemble", f"{ASSEMBLE} -o panel.bsdf", f"{ASSEMBLE} -o planned.bsdf --plan in/lab/plan/plan.ecsv --json --name panel", f"{ASSEMBLE} -o panel.bsdf", f"{ASSEMBLE} -o panel.bsdf --force --wavelength-nm 550 --phi-i 4", "brdf show panel.bsdf --wavelength-nm 550")
formats("brdf/show", "brdf show in/lab/panel.bsdf --wavelength-nm 550", "s", "ecsv", "csv", "fits", "json", "png", "svg")
case("brdf/show_options", f"brdf show {SAMPLES} --wavelength-nm 600", "brdf show in/lab/law/material.toml --wavelength-nm 550 --phi-i-deg 30 --json", "brdf show in/lab/panel.bsdf --wavelength-nm 2000", "brdf show in/lab/panel.toml --wavelength-nm 550", "brdf show in/scenes/one_material.toml --wavelength-nm 700 -o m.png -o m.ecsv")
formats("brdf/compare", "brdf compare in/lab/panel.bsdf in/lab/law/material.toml --wavelength-nm 550", "c", "ecsv", "csv", "json", "png", "svg")
case("brdf/compare_options", "brdf compare in/lab/law/material.toml in/scenes/one_material.toml --wavelength-nm 550 --json", f"brdf compare {SAMPLES} in/lab/panel.bsdf --wavelength-nm 600 --phi-i-deg 10", "brdf compare in/lab/panel.bsdf in/lab/panel.toml --wavelength-nm 550")
formats("brdf/fit", f"brdf fit {SAMPLES} --wavelength-nm 550", "f", "ecsv", "csv", "fits", "json", "png", "svg")
case("brdf/fit_options", f"brdf fit {SAMPLES} --wavelength-nm 600 --law ggx --law lambert --gaussian --json", f"brdf fit {SAMPLES} --wavelength-nm 600 --law maxwell-beard --refractive-index silicon --floor-per-sr 0.01 --name paint -o p/", f"brdf fit {SAMPLES} --wavelength-nm 600 --refractive-index aluminium")
TWO = "theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_per_sr\n30,0,10,180,0.1\n30,0,20,180,0.2\n"
refused(
    "brdf",
    "brdf retro",
    "brdf retro gone.toml -o lab/",
    "brdf retro in/lab/run.toml",
    "brdf retro in/lab/run.toml -o lab/ --resume --yes",
    "brdf retro in/lab/run.toml -o lab/ --reduce",
    "brdf ndf",
    "brdf ndf gone.ecsv",
    f"brdf ndf {SAMPLES}",
    f"brdf ndf {RETRO} --median 4",
    f"brdf ndf {RETRO} --tail long",
    f"brdf ndf {RETRO} --zero-deg x",
    "brdf ndf comma.csv",
    "brdf ndf one.csv",
    "brdf plan",
    f"brdf plan {RETRO}",
    "brdf plan gone.ecsv",
    f"brdf plan {NDF} --mark-deg 2",
    f"brdf plan {NDF} --quarter",
    f"brdf plan {NDF} --rig --side 32",
    f"brdf plan {NDF} --measurements 9",
    f"brdf plan {NDF} --hours 0.01",
    f"brdf plan {NDF} --bench bench.toml",
    "brdf ingest",
    "brdf ingest gone.toml",
    "brdf ingest in/lab/run.toml",
    "brdf fit t.csv",
    "brdf fit t.csv --wavelength-nm 532",
    "brdf fit gone.csv",
    f"brdf fit {SAMPLES}",
    f"brdf fit {SAMPLES} --wavelength-nm 550 --law blinn",
    f"brdf fit {SAMPLES} --wavelength-nm 550 --law maxwell-beard",
    "brdf assemble t.csv n.ecsv -o x.txt",
    "brdf assemble t.csv n.ecsv -o x.bsdf",
    f"brdf assemble {SAMPLES} {NDF}",
    f"brdf assemble {SAMPLES} {NDF} -o x.bsdf --plan {SAMPLES}",
    "brdf show",
    "brdf show white --wavelength-nm 550",
    "brdf show in/fixtures/bsdf/assembled.csv --wavelength-nm 550",
    "brdf show in/lab/panel.bsdf",
    "brdf show in/lab/panel.bsdf --wavelength-nm -5",
    "brdf show in/fixtures/formats/hostile/many_fields.bsdf --wavelength-nm 550",
    "brdf show in/fixtures/formats/hostile/blocks_that_overlap.bsdf --wavelength-nm 550",
    "brdf show in/fixtures/formats/hostile/shape_that_overflows.bsdf --wavelength-nm 550",
    "brdf compare in/lab/panel.bsdf",
    "brdf compare in/lab/panel.bsdf nothing --wavelength-nm 550",
    "brdf compare in/lab/panel.bsdf in/lab/panel.bsdf --wavelength-nm x",
    write={"t.csv": TWO, "comma.csv": "angle_deg;f_per_sr\n1;2\n", "one.csv": "angle_deg,f_per_sr\n1,2\n2,3\n"},
)
for name, old, new in [("key", "step_deg = 0.5", "steps_deg = 0.5"), ("value", "readings = 10", "readings = 1"), ("rig", '"rig.toml"', '"gone.toml"'), ("range", "from_deg = -10", "from_deg = 70")]:
    case(f"brdf/retro_wrong_{name}", "brdf retro run.toml -o lab/ --yes", copy=["in/lab/rig.toml"], edit={"run.toml": ("in/lab/run.toml", [(old, new)])})
EFFICIENCY = ["responsivity.csv", "splitter_t.csv", "splitter_r.csv", "visible.csv"]
formats("efficiency", "efficiency in/lab/efficiency.toml", "e", "ecsv", "csv", "fits", "json", "png", "svg")
refused("efficiency", "efficiency", "efficiency gone.toml", "efficiency in/lab/run.toml", "efficiency in/lab/efficiency.toml -o e.pdf", "efficiency in/lab/visible.csv")
for name, old, new in [
    ("key", "load_ohm = 1e6", "load_ohms = 1e6"),
    ("kind", 'kind = "counter"', 'kind = "eye"'),
    ("file", '"visible.csv"', '"gone.csv"'),
    ("value", "area_mm2 = 0.005", "area_mm2 = -0.005"),
    ("camera", 'kind = "counter"', 'kind = "camera"\ngain_e_per_adu = 0.3\nsaturation_adu = 60000'),
]:
    case(f"efficiency/wrong_{name}", "efficiency efficiency.toml", copy=[f"in/lab/{file}" for file in EFFICIENCY], edit={"efficiency.toml": ("in/lab/efficiency.toml", [(old, new)])})

# --- bench ------------------------------------------------------------------------------------------------------------------------------------------------

case("bench/scenes", "bench --scene corner --scene lambert_sphere --seconds 0.1", "bench --scene box_wing --seconds 0.1 --json", "bench in/scenes/sphere_pass.toml --station in/six_bands --seconds 0.1", "bench --scene corner --seconds 0.1 -o b/ -o b.ecsv -o b.csv -o b.fits -o b.json -o b.svg -q")
case("bench/own", "bench in/scenes/sphere_pass.toml --seconds 0.1 --json")
refused("bench", "bench gone.toml", "bench --scene cornr", "bench --seconds 0", "bench --seconds x", "bench --scene corner --seconds 0.1 -o b.pdf", "bench in/demo/satellites.tle")

# --- demo -------------------------------------------------------------------------------------------------------------------------------------------------

case("demo/all", "demo --json --open", slow=True, limit_s=900)
refused("demo", "demo -o there", "demo -o there --force", "demo -o in/lab/run.toml", "demo nothing", "demo --json --station ufo", write={"there/pass.toml": "mine"})

# --- devices ----------------------------------------------------------------------------------------------------------------------------------------------

case("devices/list", "devices list --drivers", "devices list --drivers --json", "devices list --drivers -o d.ecsv -o d.json", "devices list", "devices list --json", "devices list --all", "devices udev", "devices udev --json")
SIMULATED = ["sim-timetagger", "sim-tmcl", "sim-apt", "sim-camera", "sim-rotator", "sim-wheel", "sim-ophir", "sim-pm100", "sim-efw"]
for device in SIMULATED:
    case(f"devices/check_{device}", f"devices check {device} --exposure-s 0.1", f"devices check {device} --exposure-s 0.1 --json", f"devices check {device} --exposure-s 0.1 -o c.ecsv -o c.json -q --record c.rec", "devices replay c.rec", "devices replay c.rec --json")
case(
    "devices/read",
    "devices read sim-pm100 -n 3 --every 0.05 -o power.ecsv",
    "devices read sim-ophir --with power_w=0.0025 -n 2 --json",
    "devices read sim-ophir --with power_w=0.5",
    "devices read sim-tmcl",
    "devices read sim-wheel --json",
    "devices read sim-rotator --json",
    "devices read sim-timetagger -n 2 --exposure-s 0.1 --json --with rate_hz=20000 --with channels=2",
    "devices read sim-timetagger -n 3 --exposure-s 0.1 -o counts.ecsv -q",
)
case("devices/read_camera", "devices read sim-camera --exposure-s 0.2 -o frame.fits", "devices read sim-camera --exposure-s 0.1 --json", "devices read sim-camera -n 2 -o frames/ --exposure-s 0.1", "devices read sim-camera -n 2 -o two.fits", tries=4)
case("devices/set", "devices set sim-ophir wavelength_nm=532 range=3.00mW filter=in", "devices set sim-ophir", "devices set sim-ophir --json", "devices set sim-pm100 averaging=10 wavelength_nm=99 -o set.json", "devices set sim-pm100 range=AUTO --json", *[f"devices set {device}" for device in SIMULATED])
case("devices/move", "devices move sim-tmcl home 90 12.5", "devices move sim-efw 2", "devices move sim-wheel 2 --json", "devices move sim-rotator 15", "devices move sim-apt home 5 --json", "devices move sim-tmcl --with search_speed=20000 home 10 -5", tries=4)
case(
    "devices/more",
    "devices list --indi 127.0.0.1:1 --timeout-s 1",
    "devices read sim-pm100 --record p.rec --timeout-s 5 -o p.csv",
    "devices replay p.rec -o r.ecsv -o r.json",
    "devices set sim-pm100 --with power_w=0.001 --record s.rec --timeout-s 5 averaging=5",
    "devices replay s.rec",
    "devices move sim-efw 3 --record m.rec --timeout-s 60 -o m.ecsv -o m.json",
    "devices replay m.rec --json",
    "devices check sim-tmcl --with trust_counter=no",
    "devices read sim-rotator -n 2 --every 0.1 -o angle.fits -q",
    tries=4,
)
case("devices/record", "devices record sim-tmcl -o stage.rec -- move 45", "devices replay stage.rec", "devices record sim-efw -o w.rec -q -- move 2", "devices replay w.rec --json", "devices record sim-efw -o w.rec -- move 2", "devices record sim-efw -o w.rec --force -- read", "devices replay w.rec --driver efw", tries=4)
case("devices/replay", *[f"devices replay in/fixtures/devices/{name}.rec{more}" for name in "check_efw check_ophir check_pm100 check_rotator check_tmcl check_wheel move_efw move_tmcl_limit read_ophir_over set_ophir set_pm100_refused".split() for more in ["", " --json"]])
for driver, address in [("apt", "apt"), ("efw", "efw"), ("ophir", "ophir"), ("pm100", "pm100"), ("tmcl", "tmcl"), ("indi", "indi-camera:localhost/CCD Simulator"), ("swabian", "timetagger")]:
    case(f"devices/fixtures_{driver}", f"devices replay in/fixtures/{driver}/{'camera_good' if driver == 'indi' else 'good'}.rec --driver '{address}' -- check", f"devices replay in/fixtures/{driver}/{'camera_good' if driver == 'indi' else 'good'}.rec --driver '{address}' -- read")
refused(
    "devices",
    "devices check",
    "devices check sim-tmc",
    "devices check nothing:x",
    "devices check sim-tmcl --with gaer=3",
    "devices check sim-tmcl --with gear=x",
    "devices check sim-tmcl --timeout-s 0",
    "devices check tmcl:/dev/nothing",
    "devices check apt:/dev/nothing",
    "devices check ophir:/dev/nothing",
    "devices check efw:/dev/nothing",
    "devices check pm100:P9999999",
    "devices check indi-camera:127.0.0.1:1/CCD --timeout-s 2",
    "devices read sim-pm100 -n 0",
    "devices read sim-pm100 --every -1",
    "devices read sim-camera -n 2 -o two.fits",
    "devices set sim-ophir wavelength_nm",
    "devices set sim-ophir colour=red",
    "devices set sim-ophir wavelength_nm=x",
    "devices move sim-tmcl",
    "devices move sim-tmcl here",
    "devices move sim-efw 12",
    "devices move sim-pm100 3",
    "devices record sim-efw -o x.rec -- turn 3",
    "devices record sim-efw -- move 2",
    "devices replay gone.rec",
    "devices replay in/demo/pass.toml",
    "devices replay in/fixtures/ophir/good.rec",
    "devices replay in/fixtures/devices/check_efw.rec --driver ophir",
    "devices replay in/fixtures/devices/check_efw.rec -- read",
    "devices list --indi 127.0.0.1:1 --json",
    "devices list --drivers -o d.png",
)
case("devices/stopped", "devices move sim-tmcl home 300", interrupt_s=2, tries=4)
case("devices/timetagger", "devices check timetagger", "devices check timetagger:2138000XYZ --json", env={"SUNGLINT_SWABIAN_PYTHON": "/bin/false"})

# --- what is the same for all -----------------------------------------------------------------------------------------------------------------------------

case(
    "all/outputs",
    "air --station ufo --zenith 0 --step-nm 10 -o there",
    "air --station ufo --zenith 0 --step-nm 10 -o new.ecsv -o there/",
    "air --station ufo --zenith 0 --step-nm 10 -o new.ecsv -o there/air.svg/a.csv",
    "air --station ufo --zenith 0 --step-nm 10 -o new.ecsv -o ./new.ecsv --force",
    "air --station ufo --zenith 0 --step-nm 10 -o fresh/ -o fresh/air.png",
    "air --station ufo --zenith 0 --step-nm 10 -o .csv",
    "air --station ufo --zenith 0 --step-nm 10 -o /dev/null",
    "air --station ufo --zenith 0 --step-nm 10 -o - -o e.json",
    "air --station ufo --zenith 0 --step-nm 10 -o there --force",
    write={"there/air.svg": "mine"},
)
AIR = "--profile us_standard --pressure-hpa 960 --ozone-du 300 --water-mm 5 --co2-ppm 400 --aerosol 0.1,1.3 --no-refraction"
case(
    "all/air_options",
    f"{VEGA} {AIR}",
    f"{DEMO} --norad 99004 {AIR}",
    f"calibrate in/demo/reduced --station ufo {AIR}",
    f"{APPLY} --magnitudes V {AIR}",
    f"analyse fold {TURNING} --station ufo --period 20 {AIR}",
    f"analyse period {TURNING} --station ufo {AIR} --keep range --keep phase",
    f"{UNMIX} --endmembers white,mli {AIR} --json",
    f"analyse endmembers in/sims/six/box_wing_pass.ecsv --station in/six_bands --noise 0.01 {AIR}",
    f"analyse endmembers in/sims/six/box_wing_pass.ecsv --station in/six_bands --noise 0.01 --no-air",
)
case(
    "all/verbose",
    f"simulate {SCENES}/sphere_pass.toml -v",
    f"explain {SCENES}/sphere_pass.toml -vv",
    f"{SPHERE} -v --channel g",
    f"picture {PASS} {SMALL} -v",
    f"{DEMO} -v --limit 1",
    f"reduce {SHORT} -v",
    f"align {SHORT} -v",
    "calibrate in/linear --station ufo -v",
    f"{APPLY} -v",
    f"{FIT} -v",
    f"analyse fold {TURNING} --station ufo --period 20 -v",
    f"analyse period {TURNING} --station ufo -v",
    f"{UNMIX} --endmembers white -v",
    "analyse map in/scenes/spinning.toml --step-deg 30 -v",
    f"{ATTITUDE} --known axis,period -v",
    "analyse endmembers in/sims/turning_spectra.fits --noise 1e-3 -v",
    "efficiency in/lab/efficiency.toml -v",
    f"brdf ndf {RETRO} --resamplings 2 -v",
    f"brdf plan {NDF} --side 5 -v",
    "brdf ingest in/lab/ingest.toml -v",
    f"brdf fit {SAMPLES} --wavelength-nm 550 -v --law lambert",
    "brdf show in/lab/panel.bsdf --wavelength-nm 550 -v",
    "tables sun -v",
    f"session check {SHORT} -vv",
)
case(
    "all/quiet",
    f"simulate {SCENES}/sphere_pass.toml -q",
    f"{SPHERE} -q -o c.csv",
    f"{DEMO} -q --limit 1",
    f"reduce {SHORT} -q",
    f"align {SHORT} -q",
    "calibrate in/linear --station ufo -q",
    f"{APPLY} -q",
    f"{FIT} -q",
    f"analyse period {TURNING} --station ufo -q",
    f"{UNMIX} --endmembers white -q",
    "efficiency in/lab/efficiency.toml -q",
    f"brdf ndf {RETRO} --resamplings 2 -q",
    "brdf show in/lab/panel.bsdf --wavelength-nm 550 -q",
)
TWICE = [
    ("tables sun", "x.csv"),
    (VEGA, "x.csv"),
    (f"simulate {SCENES}/one.toml", "x.ecsv"),
    (f"explain {SCENES}/one.toml", "x.csv"),
    (f"{SPHERE} --channel g", "x.html"),
    ("picture --sphere", "x.png"),
    (f"{DEMO} --limit 1", "x.ecsv"),
    (f"reduce {SHORT}", "x.ecsv"),
    (f"align {SHORT}", "x.ecsv"),
    ("calibrate in/linear --station ufo", "x.ecsv"),
    (APPLY, "x.ecsv"),
    (f"{FIT} --channel g", "x.ecsv"),
    (f"analyse fold {TURNING} --station ufo --period 20", "x.ecsv"),
    (f"analyse period {TURNING} --station ufo", "x.ecsv"),
    (f"{UNMIX} --endmembers white", "x.ecsv"),
    ("analyse map in/scenes/spinning.toml --step-deg 30", "x.fits"),
    ("analyse endmembers in/sims/turning_spectra.fits --noise 1e-3", "x.ecsv"),
    ("efficiency in/lab/efficiency.toml", "x.csv"),
    (f"brdf ndf {RETRO} --resamplings 0", "x.ecsv"),
    (f"brdf plan {NDF} --side 5", "x.ecsv"),
    ("brdf ingest in/lab/ingest.toml", "x.ecsv"),
    (f"brdf fit {SAMPLES} --wavelength-nm 550 --law lambert", "x.ecsv"),
    ("brdf show in/lab/panel.bsdf --wavelength-nm 550", "x.ecsv"),
    ("brdf compare in/lab/panel.bsdf in/lab/panel.bsdf --wavelength-nm 550", "x.ecsv"),
    ("devices list --drivers", "x.ecsv"),
    ("devices set sim-pm100", "x.json"),
]
case(
    "all/force",
    *[f"{command} -q -o {file}{more}" for command, file in TWICE for more in ["", " --force"]],
    write={file: "mine" for _, file in TWICE},
)
case("all/nowhere", *[f"{command} -q -o nowhere/{file}" for command, file in TWICE], *[f"{command} -q -o x.pdf" for command, file in TWICE])
case("all/threads", *[f"{command} -q -o one/ --threads 1" for command, file in TWICE if file.startswith("x.ecsv") and "devices" not in command], limit_s=900)
HOSTILE = "in/fixtures/formats/hostile"
case(
    "all/hostile",
    f"compare {HOSTILE}/alias_bomb.ecsv in/demo/sphere.toml",
    f"compare {HOSTILE}/open_quote.ecsv in/demo/sphere.toml",
    f"compare {HOSTILE}/nan.csv in/demo/sphere.toml",
    f"compare {HOSTILE}/turning.csv in/demo/sphere.toml",
    f"simulate {HOSTILE}/deep.toml",
    *[f"analyse unmix {HOSTILE}/{name}.fits --endmembers white" for name in ["cut_off", "no_end", "rows_of_nothing", "sizes_that_overflow", "trillion_pixels", "no_groups"]],
    *[f"reduce {SHORT} --flat {HOSTILE}/{name}.fits" for name in ["cut_off", "no_end", "rows_of_nothing", "sizes_that_overflow", "trillion_pixels", "no_groups"]],
)

# --- what is the time now ---------------------------------------------------------------------------------------------------------------------------------

# The computer's clock stands still at this moment for them.
FROZEN = ["faketime", "-f", "2020-11-18 17:00:00"]
case(
    "now/all",
    "star Vega --station ufo",
    "star Vega --station ufo --json",
    "star Vega --station ufo --at now --to 2020-11-18T19:00:00",
    "passes --tle in/demo/satellites.tle --station ufo --limit 3",
    "passes --tle in/demo/satellites.tle --station ufo --from now --to 2020-11-18T20:00:00 --json",
    "simulate in/demo/sphere.toml --from now --to 2020-11-18T17:01:00",
    tool=FROZEN,
)

# --- what differs from run to run -------------------------------------------------------------------------------------------------------------------------

# How a status line of a night begins.
STATUS = re.compile(r"^(?:\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\dZ|\[time\])  ")


def events(text):
    lines = [line for line in text.splitlines() if '"kind":"sync"' not in line]
    return "\n".join(sorted(lines)) + "\n"


def night_messages(text):
    lines = [line for line in text.splitlines() if not STATUS.match(line) and '"kind":"status"' not in line]
    return "\n".join(sorted(lines)) + "\n"


def counted(text):
    """A counter's bins with their own time from the first bin, without UTC."""
    lines, first = [], None
    for line in text.splitlines():
        cells = line.split(",")
        if line.startswith("[time],") and len(cells) > 4 and cells[1].isdigit():
            first = int(cells[1]) if first is None else first
            line = ",".join(["", str(int(cells[1]) - first), *cells[2:]])
        lines.append(line)
    return "\n".join(lines) + "\n"


def bench_rows(text):
    """Rows of a table of `bench` without its times and numbers of repeats."""
    lines = []
    for line in text.splitlines():
        cells = line.split(",")
        if len(cells) == 12 and cells[2].isdigit():
            cells[4:9] = ["[measured]"] * 5
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


# What a frame's header says that goes with the time, besides times.
TIMELY = [b"HOSTDIFF", b"CENTAZ", b"CENTALT", b"RA", b"DEC"]


def frame(content):
    """A frame without the times in its header."""
    cards = [content[i : i + 80] for i in range(0, len(content), 80)]
    for i, card in enumerate(cards):
        if card.rstrip() == b"END":
            break
        if card[:8].strip() in TIMELY or re.search(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", card):
            cards[i] = card[:10] + b"[time]"
    return b"".join(cards)


def tags(content):
    """Raw tags without their times."""
    whole = len(content) // 16 * 16
    return b"".join(content[i : i + 8] for i in range(0, whole, 16)) + content[whole:]


# Where a number stands.
N = r"\d+(?:\.\d+)?(?:e-?\d+)?"
# Cases on the computer's clock.
LIVE = ["observe/live*", "devices/*"]

# Rules. Of these cases and outputs (patterns) `find` (a regular expression) is replaced by `put`, then `rewrite` (a function of the text) or `rewrite_bytes` (of the bytes) is
# applied. `name` in the name of a file is replaced by `put`. With `hide` the output is not compared. `why` says why it differs from run to run.
MASKS = [
    {"case": "*", "output": "*", "find": r"sunglint \d+\.\d+\.\d+", "put": "sunglint [version]", "why": "the program's version"},
    # Seconds that were taken.
    {"case": "*", "output": "*", "find": rf"^cost: {N} s on (\d+) threads?(?: \(.*\), {N} µs an epoch)?", "put": r"cost: [seconds] s on \1 threads", "why": "seconds that a simulation took"},
    {"case": "*", "output": "*", "find": rf"{N} s for the means over", "put": "[seconds] s for the means over", "why": "the same"},
    {"case": "*", "output": "*", "find": rf'"(total_s|seconds|us_per_epoch)": {N}', "put": r'"\1": [seconds]', "why": "seconds that a command took, in JSON"},
    {"case": "*", "output": "*.html", "find": rf"<p>{N} s on (\d+) threads? for (\d+) epochs \({N} µs an epoch\)", "put": r"<p>[seconds] s on \1 threads for \2 epochs ([seconds] µs an epoch)", "why": "the same, on a page"},
    {"case": "*", "output": "*", "find": rf"simulations in {N} s", "put": "simulations in [seconds] s", "why": "seconds that a fit took"},
    {"case": "*", "output": "*.html", "find": rf"<dd>{N}\u00a0s<small>", "put": "<dd>[seconds] s<small>", "why": "the same, on a page"},
    {"case": "*", "output": "*", "find": rf"epochs simulated in {N} s", "put": "epochs simulated in [seconds] s", "why": "seconds that a search took"},
    # What `bench` is for.
    {"case": "bench/*", "output": "*", "find": rf'("(?:seconds_\w+|repeats|epochs_per_repeat)": ?){N}', "put": r"\1[measured]", "why": "times that were measured"},
    {"case": "bench/*", "output": "std*", "find": rf" +{N} (?:ns|µs|ms|s)(?= )", "put": " [measured]", "why": "times that were measured"},
    {"case": "bench/*", "output": ["*.ecsv", "*.csv", "std*"], "rewrite": bench_rows, "why": "times that were measured"},
    {"case": "bench/*", "output": ["*.fits", "*.svg", "*.png"], "hide": True, "why": "they show times that were measured"},
    # Devices that live on the computer's clock.
    {"case": LIVE, "output": "*", "find": r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z?", "put": "[time]", "why": "when it was"},
    {"case": LIVE, "output": "*", "find": rf'"took_s": {N}', "put": '"took_s": [seconds]', "why": "seconds that a move took"},
    {"case": "devices/move", "output": "std*", "find": rf"(deg after ){N} s", "put": r"\1[seconds] s", "why": "seconds that a move took, by the computer's clock"},
    {"case": LIVE, "output": "*.rec", "find": r"^~ [\d.]+\n", "put": "", "why": "pauses between what was said"},
    {"case": ["devices/check_sim-timetagger", "devices/check_sim-camera"], "output": "*.rec", "find": r"(?:^< .*\n)+", "put": "< [bytes]\n", "why": "what these say holds the time"},
    {"case": "devices/record", "output": "stage.rec", "find": r"(?:^[<>] .*\n)+", "put": "[bytes]\n", "why": "the stage is asked where it stands until it is there"},
    {"case": ["observe/live_stopped", "devices/stopped"], "output": "std*", "find": r"\d+(?:\.\d+)?", "put": "[number]", "why": "Ctrl-C comes at one moment or another"},
    {"case": "observe/live_stopped", "output": ["s/*", "kind and mode"], "hide": True, "why": "the same"},
    {"case": LIVE, "output": "*.fits", "rewrite_bytes": frame, "why": "when frames were taken"},
    {"case": LIVE, "output": "*.tags", "rewrite_bytes": tags, "why": "the counter's own clock begins with the program"},
    {"case": LIVE, "output": "*", "rewrite": counted, "why": "the counter's own clock begins with the program"},
    {"case": LIVE, "name": r"/\d\d/\d{8}T\d{6}\.\d{6}Z_", "put": "/[hour]/[time]_", "why": "when frames were taken"},
    {"case": LIVE, "output": "kind and mode", "find": r"/\d\d(?:/\d{8}T\d{6}\.\d{6}Z_|$)", "put": "/[hour]/[time]_", "why": "the same"},
    {"case": "devices/more", "output": "m.ecsv", "find": r",[\d.]+$", "put": ",[seconds]", "why": "seconds that a move took"},
    {"case": "devices/more", "output": "angle.fits", "hide": True, "why": "its table holds times"},
    # Nights.
    {"case": "observe/*", "output": "std*", "find": r"\b\d+ events", "put": "[number] events", "why": "`sync` events come four times a second of the computer's clock"},
    {"case": "*", "output": "*events.jsonl", "rewrite": events, "why": "threads of devices write as they come; `sync` events come four times a second of the computer's clock"},
    {"case": "observe/*", "output": "std*", "rewrite": night_messages, "why": "status lines come after seconds of the computer's clock; messages of devices come as their threads do"},
]
