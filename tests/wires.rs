//! A goniometer whose devices are on real lines: another program serves them, ours drives them, is killed, and goes on.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::served::Server;
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use sunglint_formats::ecsv;
use sunglint_simulator::surface::measured;
use sunglint_testkit::{Campaign, repository, run_python, skip};

/// A sample: GGX microfacets over a Lambert part.
#[derive(Debug, Clone, Copy)]
struct Law {
    alpha: f64,
    reflectance: f64,
    base: f64,
}

impl Law {
    /// f, sr⁻¹: Walter et al. (2007), eqs. 33 and 34, with light and observer masked together; D as Trowbridge and Reitz (1975) wrote it.
    fn f(&self, i: DVec3, o: DVec3) -> f64 {
        let h = (i + o).normalize();
        let a2 = self.alpha * self.alpha;
        let density = a2 / (PI * (h.z * h.z * (a2 - 1.0) + 1.0).powi(2));
        let seen = |z: f64| 2.0 / (1.0 + (1.0 + a2 * (1.0 / (z * z) - 1.0)).sqrt());
        let lobe = self.reflectance * density * seen(i.z).min(seen(o.z)) / (4.0 * i.z * o.z);
        lobe + self.base / PI
    }

    fn toml(&self) -> String {
        let Self { alpha, reflectance, base } = self;
        format!(
            "[sample]\nkind = \"ggx\"\nalpha = {alpha}\nreflectance = {reflectance}\nbase_reflectance = {base}\n"
        )
    }
}

fn direction(theta_deg: f64, phi_deg: f64) -> DVec3 {
    let ((s, c), (sp, cp)) = (theta_deg.to_radians().sin_cos(), phi_deg.to_radians().sin_cos());
    DVec3::new(s * cp, s * sp, c)
}

/// Numbers by a seed: SplitMix64 (Steele, Lea and Flood, 2014).
struct Random(u64);

impl Random {
    /// From 0 to 1.
    fn part(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// One bench.
struct Case {
    seed: u64,
    law: Law,
    over_tcp: bool,
    directions: u32,
    kills: u32,
}

impl Case {
    fn new(seed: u64, directions: u32, kills: u32) -> Self {
        let mut random = Random(seed);
        let alpha = 0.1 + 0.2 * random.part();
        // Bare metal, glossy paint.
        let law = match seed % 2 {
            0 => Law { alpha, reflectance: 0.8, base: 0.0 },
            _ => Law { alpha, reflectance: 0.05, base: 0.5 },
        };
        Self { seed, law, over_tcp: (seed / 2 + seed) % 2 == 1, directions, kills }
    }

    /// The relative noise of a reading.
    const NOISE: f64 = 0.005;
    /// Readings at a place.
    const READINGS: usize = 3;

    /// A folder with a distribution of the sample and a plan.
    fn folder(&self) -> Folder {
        let folder = Folder::new(&format!("wires-{}", self.seed));
        let write = |name: &str, text: String| std::fs::write(folder.path(name), text).unwrap();
        write("run.toml", crate::common::page_toml("lab.md", "[scan]"));
        write("rig.toml", self.law.toml());
        folder.done(&["brdf", "retro", "run.toml", "-q", "-o", "lab/"]);
        let ndf = ["brdf", "ndf", "lab/retro.ecsv", "-q", "--force", "-o", "lab/"];
        folder.done(&[&ndf[..], &["--resamplings", "3"]].concat());
        let count = self.directions.to_string();
        let plan = ["brdf", "plan", "lab/ndf.ecsv", "-q", "--force", "-o", "lab/"];
        folder.done(&[&plan[..], &["--measurements", &count]].concat());
        // Stages and meter that are some hundred times as fast as real ones.
        write(
            "goniometer.toml",
            format!(
                "seed = {}\n{}[zero]\nsample_deg = 0.21\ndetector_deg = -0.13\n[lamp]\nnoise = {}\n[stage]\nspeed_deg_per_s = 3000\nbacklash_deg = 0.04\n[meter]\nreading_s = 0.004\nsettling_s = 0.004\n",
                self.seed,
                self.law.toml(),
                Self::NOISE
            ),
        );
        folder
    }

    /// A bench on lines, with the file of a run on it and a program for its hands.
    fn serve(&self, folder: &Folder, name: &str) -> Server {
        let bench = format!("{name}.toml");
        let ports = format!("{name}-ports");
        let wire = if self.over_tcp { ["--tcp", "0"] } else { ["--pty", &ports] };
        let server = Server::start(
            folder,
            &[&["goniometer.toml", "-q", "--force", "-o", &bench][..], &wire].concat(),
        );
        shorten(folder, &bench);
        let devices = server.begun["devices"].as_array().unwrap();
        let names: Vec<&str> = devices.iter().map(|d| d["name"].as_str().unwrap()).collect();
        assert_eq!(names, ["sample", "detector", "azimuth", "turn", "meter", "hands"]);
        let at = devices[5]["address"].as_str().unwrap();
        let at = match at.strip_prefix("tcp:") {
            Some(port) => format!("/dev/tcp/{}", port.replace(':', "/")),
            None => at.to_owned(),
        };
        let text = format!(
            "#!/bin/bash\nexec 3<>{at} && echo \"$1\" >&3 && read -r -t 20 done <&3 && [ \"$done\" = \"$1\" ]\n"
        );
        executable(folder, &format!("{name}-hands"), &text);
        server
    }

    fn spawn(folder: &Folder, name: &str, goes_on: bool) -> Child {
        let (bench, hands) = (format!("{name}.toml"), format!("./{name}-hands"));
        let run = ["brdf", "run", "lab/plan.ecsv", "--bench", &bench, "--hands", &hands];
        let said = std::fs::File::options()
            .create(true)
            .append(true)
            .open(folder.path(&format!("{name}.said")))
            .unwrap();
        Command::new(crate::common::program())
            .args(run)
            .args(["-q", "-o", &format!("{name}/")])
            .args(goes_on.then_some("--resume"))
            .current_dir(&folder.0)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(said)
            .spawn()
            .unwrap()
    }

    /// A run whose devices go away.
    fn pulled(&self, folder: &Folder, name: &str, server: Server) {
        let mut child = Self::spawn(folder, name, false);
        let readings = folder.path(name).join("readings.ecsv");
        let begun = Instant::now();
        while std::fs::metadata(&readings).map_or(0, |m| m.len()) < 6_000 {
            let said = || std::fs::read_to_string(folder.path(&format!("{name}.said"))).unwrap();
            assert!(child.try_wait().unwrap().is_none(), "it ended: {}", said());
            assert!(begun.elapsed().as_secs() < 120, "it does not begin: {}", said());
            std::thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(server.end().0.code(), Some(0));
        assert_eq!(child.wait().unwrap().code(), Some(1));
        let said = std::fs::read_to_string(folder.path(&format!("{name}.said"))).unwrap();
        assert!(said.contains("go on with --resume"), "{said}");
    }

    /// Runs to the end, killed on the way. How often it was killed, and how long all took.
    fn run(&self, folder: &Folder, name: &str, kills: u32, whole: Duration) -> (u32, Duration) {
        /// Time that a run takes until it measures: devices are opened and find their references.
        const BEGINS: Duration = Duration::from_millis(1500);
        let mut random = Random(self.seed ^ 0x5eed);
        let readings = folder.path(name).join("readings.ecsv");
        let bytes = || std::fs::read(&readings).unwrap_or_default();
        let (mut killed, begun) = (0, Instant::now());
        let mut before = Vec::new();
        loop {
            let mut child = Self::spawn(folder, name, readings.exists());
            if killed < kills {
                let most = BEGINS + whole.mul_f64(1.6 / f64::from(kills));
                let until = Instant::now() + most.mul_f64(random.part());
                while Instant::now() < until && child.try_wait().unwrap().is_none() {
                    std::thread::sleep(Duration::from_millis(2));
                }
                if child.try_wait().unwrap().is_none() {
                    child.kill().unwrap();
                    child.wait().unwrap();
                    killed += 1;
                    let now = bytes();
                    assert!(now.starts_with(&before), "{name} {killed}: readings were lost");
                    let kept = now.iter().rposition(|b| *b == b'\n').map_or(0, |end| end + 1);
                    before = now[..kept].to_vec();
                    continue;
                }
            }
            let status = child.wait().unwrap();
            let said = std::fs::read_to_string(folder.path(&format!("{name}.said"))).unwrap();
            assert!(status.success(), "{name} after {killed} kills: {said}");
            assert!(bytes().starts_with(&before), "{name}: readings were lost");
            return (killed, begun.elapsed());
        }
    }
}

/// Powers of the readings that count, by part and number.
type Kept = BTreeMap<(String, i64), Vec<f64>>;

/// Reads what a record holds. No measurement is there twice, and each has all of its readings.
fn record(folder: &Folder, name: &str) -> Kept {
    let table = ecsv::read(folder.path(name).join("readings.ecsv")).unwrap();
    let text = |column: &str| -> Vec<String> {
        table.text(column).unwrap().iter().map(|t| t.clone().unwrap_or_default()).collect()
    };
    let (part, state) = (text("part"), text("state"));
    let (number, power) = (table.f64("number").unwrap(), table.f64("power_w").unwrap());
    let mut kept = Kept::new();
    let mut open: Vec<f64> = Vec::new();
    for row in 0..table.rows() {
        match state[row].as_str() {
            "read" => open.push(power[row]),
            "again" => open.clear(),
            "kept" => {
                let readings = std::mem::take(&mut open);
                assert_eq!(readings.len(), Case::READINGS, "{name} {} {}", part[row], number[row]);
                let twice = kept.insert((part[row].clone(), number[row] as i64), readings);
                assert!(twice.is_none(), "{name}: {} {} is there twice", part[row], number[row]);
            }
            other => panic!("{name}: {other} in row {row}"),
        }
    }
    assert!(open.is_empty(), "{name}: readings without an end");
    kept
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Largest |a − b| over its standard deviation for the directions of two records of the same run.
fn apart(one: &Kept, other: &Kept) -> f64 {
    // A look at the reference after each break is more, and no other line is.
    let own = |kept: &Kept| -> BTreeSet<(String, i64)> {
        kept.keys()
            .filter(|(part, number)| part != "reference" || *number < 1000)
            .cloned()
            .collect()
    };
    assert_eq!(own(one), own(other));
    let mut worst = 0.0_f64;
    for (key, values) in one.iter().filter(|((part, _), _)| part == "direction") {
        let [a, b] = [mean(values), mean(&other[key])];
        // Noise of both means; a Vega tells four digits; the least light is a digit of the meter behind it.
        let sigma = a.abs().max(b.abs())
            * (2.0 * Case::NOISE * Case::NOISE / Case::READINGS as f64 + 5e-4_f64.powi(2)).sqrt();
        worst = worst.max((a - b).abs() / (sigma + 1e-13));
    }
    worst
}

/// Errors of the values of a run against the closed form: the largest part beyond 4 stated σ, over the value (the scatter of three readings tells σ badly), and how many values there are.
fn against_truth(folder: &Folder, case: &Case, name: &str) -> (f64, usize) {
    let values = format!("{name}-values/");
    folder.done(&["brdf", "ingest", &format!("{name}/"), "-q", "-o", &values]);
    let table = ecsv::read(folder.path(&values).join("samples.ecsv")).unwrap();
    let column = |name: &str| table.f64(name).unwrap().to_vec();
    let angles = ["theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg"].map(column);
    let (f, sigma) = (column("brdf_632.8nm_per_sr"), column("sigma_632.8nm_per_sr"));
    let mut worst = 0.0_f64;
    for k in 0..f.len() {
        let [ti, pi, to, po] = [0, 1, 2, 3].map(|a| angles[a][k]);
        let truth = case.law.f(direction(ti, pi), direction(to, po));
        worst = worst.max(((f[k] - truth).abs() - 4.0 * sigma[k]) / truth);
    }
    (worst, f.len())
}

/// Errors of the assembled material up to 70° of light and detector: those that half, 90 and 99 of 100 directions do not exceed, by our evaluator and by Mitsuba; and how far both are apart, over the value and 1e-3 of the largest.
struct Errors {
    ours: [f64; 3],
    mitsuba: [f64; 3],
    evaluators: f64,
}

fn assembled(folder: &Folder, law: Law, file: &str) -> Errors {
    let made = measured::read(file, folder.path(file)).unwrap();
    let truth: Vec<f64> = directions().map(|(i, o)| law.f(i, o)).collect();
    let parts = |values: &[f64]| {
        let mut errors: Vec<f64> =
            values.iter().zip(&truth).map(|(f, truth)| (f / truth - 1.0).abs()).collect();
        errors.sort_by(f64::total_cmp);
        [0.5, 0.9, 0.99].map(|part| errors[(part * errors.len() as f64) as usize])
    };
    let ours: Vec<f64> = directions().map(|(i, o)| made.brdf(632.8, i, o)).collect();
    let mut errors = Errors { ours: parts(&ours), mitsuba: [f64::NAN; 3], evaluators: f64::NAN };
    if let Some(python) = mitsuba() {
        let line = |v: DVec3| format!("{} {} {}", v.x, v.y, v.z);
        let rows: Vec<String> =
            directions().map(|(i, o)| format!("{} {}", line(i), line(o))).collect();
        std::fs::write(folder.path("directions"), rows.join("\n")).unwrap();
        let [file, rows] = [file, "directions"].map(|name| folder.path(name));
        let printed =
            run_python(&python, MITSUBA, &[file.to_str().unwrap(), rows.to_str().unwrap()]);
        let theirs: Vec<f64> = printed
            .lines()
            .zip(directions())
            .map(|(value, (_, o))| value.parse::<f64>().unwrap() / o.z)
            .collect();
        assert_eq!(theirs.len(), truth.len());
        let largest = ours.iter().copied().fold(0.0, f64::max);
        let apart = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs() / (b + 1e-3 * largest));
        errors.mitsuba = parts(&theirs);
        errors.evaluators = apart.fold(0.0, f64::max);
    }
    errors
}

/// A Python with Mitsuba 3: the one that is named, or one that `benches/against_mitsuba` or `python/check` makes.
fn mitsuba() -> Option<PathBuf> {
    let named = std::env::var_os("SUNGLINT_MITSUBA_PYTHON").map(PathBuf::from);
    let made = [".venv-mitsuba", ".venv-python"];
    let made = made.iter().map(|v| repository().join(v).join("bin/python"));
    let found = named.into_iter().chain(made).filter(|python| python.exists()).find(|python| {
        let imports = Command::new(python).args(["-c", "import mitsuba"]).output();
        imports.is_ok_and(|done| done.status.success())
    });
    if found.is_none() {
        let why = "no Python with mitsuba (benches/against_mitsuba makes .venv-mitsuba)";
        skip("what_lines_made_by_mitsuba", why);
    }
    found
}

/// Values of Mitsuba's plug-in `measured`: f cosθ_o at 632.8 nm.
const MITSUBA: &str = r#"
import sys
import mitsuba as mi
mi.set_variant("scalar_spectral")
bsdf = mi.load_dict({"type": "measured", "filename": sys.argv[1]})
for line in open(sys.argv[2]):
    v = [float(x) for x in line.split()]
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*v[:3])
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.wavelengths = mi.Spectrum([632.8] * 4)
    print(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*v[3:]), True)[0])
"#;

/// Directions up to 70°, half of them within 20° of the mirrored one.
fn directions() -> impl Iterator<Item = (DVec3, DVec3)> {
    let mut random = Random(70);
    (0..400).map(move |k| {
        let theta = 1.0 + 69.0 * random.part();
        let i = direction(theta, 0.0);
        let (t, p) = if k % 2 == 0 {
            let off = 30.0 * random.part() - 15.0;
            ((theta + off).clamp(1.0, 70.0), 180.0 + 30.0 * random.part() - 15.0)
        } else {
            ((1.0 + 69.0 * random.part()), 360.0 * random.part())
        };
        (i, direction(t, p))
    })
}

/// GGX and glossy paint over ptys and TCP, killed. Truth: the closed forms of the samples, which the bench does not share with the reduction; and, in the whole campaign, the same bench without a break.
/// A kill is SIGKILL at a seeded moment: 20 a run of 40 measurements, 3 of 24 in the part that every run of the suite has. Promises: no reading lost or doubled; values within 4 σ and 3 % of the truth; the readings of both runs within 5 of their
/// standard deviations; the assembled material within 3 % in nine of ten directions up to 70° and within 10 % in 99 of 100, by our evaluator and by Mitsuba 3's plug-in `measured` where there is one, which agree within 1 % (single precision).
#[test]
fn campaign_goniometer_wires() {
    let mut campaign = Campaign::with_part("goniometer_wires", 10, 2);
    let whole = campaign.is_asked_for();
    let (directions, kills) = if whole { (40, 20) } else { (24, 3) };
    let seeds: Vec<u64> = campaign.seeds().collect();
    let mut most = [f64::NAN; 6];
    for pair in seeds.chunks(2) {
        let found: Vec<[f64; 6]> = std::thread::scope(|scope| {
            let begun: Vec<_> = pair
                .iter()
                .map(|seed| scope.spawn(move || one(&Case::new(*seed, directions, kills), whole)))
                .collect();
            begun.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        for figures in found {
            most.iter_mut().zip(figures).for_each(|(most, figure)| *most = most.max(figure));
        }
    }
    campaign.largest("kills_of_a_run", f64::from(kills));
    // In real time no two runs are alike, so that a part may exceed the whole.
    for (name, value) in FIGURES.into_iter().zip(most).filter(|f| whole && f.1.is_finite()) {
        campaign.largest(name, value);
    }
    campaign.finish();
}

/// Figures of a run.
const FIGURES: [&str; 6] = [
    "largest_sigmas_from_the_whole_run",
    "largest_error_of_a_value_beyond_4_sigma",
    "error_of_90_percent_of_directions",
    "error_of_99_percent_of_directions",
    "error_of_99_percent_by_mitsuba",
    "evaluators_apart",
];

/// The commands of docs/lab-run.md, as they stand, on its bench, which measures itself in fewer steps. Truth: the sample of its `fast.toml` (alpha 0.1, reflectance 0.8), 3 % at nine of ten directions: 40 measurements.
#[test]
fn from_a_plan_to_a_material_on_lines() {
    let case = Case {
        seed: 0,
        law: Law { alpha: 0.1, reflectance: 0.8, base: 0.0 },
        over_tcp: false,
        directions: 40,
        kills: 0,
    };
    let folder = case.folder();
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/lab-run.md");
    let page = std::fs::read_to_string(page).unwrap();
    let blocks = |kind: &str| -> Vec<String> {
        let begin = format!("```{kind}\n");
        let all = page.split(&begin).skip(1);
        all.map(|block| block.split("```").next().unwrap().to_owned()).collect()
    };
    let fast = crate::common::page_toml("lab-run.md", "reading_s = 0.004");
    std::fs::write(folder.path("fast.toml"), fast).unwrap();
    executable(&folder, "hands", &blocks("bash")[0]);
    let commands = blocks("sh");
    let words = |command: &str| -> Vec<String> {
        command.split_whitespace().skip(1).map(str::to_owned).collect()
    };
    let serve = words(&commands[1]);
    let serve: Vec<&str> = serve.iter().skip(2).map(String::as_str).collect();
    let server = Server::start(&folder, &serve);
    shorten(&folder, "bench.toml");
    assert_eq!(commands[2].lines().count(), 4, "{}", commands[2]);
    for command in commands[2].lines() {
        let words = words(command);
        folder.done(&words.iter().map(String::as_str).collect::<Vec<_>>());
    }
    let errors = assembled(&folder, case.law, "wired.bsdf");
    assert!(errors.ours[1] < 0.03, "{:?}", errors.ours);
    let (status, _) = server.end();
    assert_eq!(status.code(), Some(0));
    assert!(!folder.path("ports/sample").is_symlink(), "the ports are gone with the bench");
}

/// Lets a bench measure itself in few steps.
fn shorten(folder: &Folder, bench: &str) {
    let scans = format!(
        "\n[scan]\nreadings = {}\nreference_every = 20\n[signature]\nhalf_width_deg = 1.6\nstep_deg = 0.4\n[floor]\nstep_deg = 30\n[zero]\nhalf_width_deg = 6\nstep_deg = 1.5\n",
        Case::READINGS
    );
    let made = std::fs::read_to_string(folder.path(bench)).unwrap();
    std::fs::write(folder.path(bench), made + &scans).unwrap();
}

/// Writes a program, by another program: one of ours that starts meanwhile could hold it open for writing.
fn executable(folder: &Folder, name: &str, text: &str) {
    let made = Command::new("sh")
        .args(["-c", "printf %s \"$1\" > \"$2\" && chmod 755 \"$2\"", "sh", text])
        .arg(folder.path(name))
        .status();
    assert!(made.unwrap().success());
}

/// Figures of a run: see [`FIGURES`].
fn one(case: &Case, whole: bool) -> [f64; 6] {
    let folder = case.folder();
    let mut took = Duration::from_secs(8);
    let undisturbed = whole.then(|| {
        let server = case.serve(&folder, "undisturbed");
        took = case.run(&folder, "undisturbed", 0, took).1;
        drop(server);
        record(&folder, "undisturbed")
    });
    let mut server = case.serve(&folder, "killed");
    if !case.over_tcp {
        // All cables are pulled out, and the devices have lost their power when they are in again.
        case.pulled(&folder, "killed", server);
        server = case.serve(&folder, "killed");
    }
    let (kills, all) = case.run(&folder, "killed", case.kills, took);
    drop(server);
    let kept = record(&folder, "killed");
    let apart = undisturbed.map_or(f64::NAN, |undisturbed| apart(&undisturbed, &kept));
    let (off, values) = against_truth(&folder, case, "killed");
    let assemble = ["brdf", "assemble", "killed-values/samples.ecsv", "lab/ndf.ecsv", "-q"];
    folder.done(&[&assemble[..], &["-o", "made.bsdf"]].concat());
    let errors = assembled(&folder, case.law, "made.bsdf");
    println!(
        "seed {}: {:?} over {}: {kills} kills, {} measurements in {:.1} s ({:.1} s undisturbed), apart {apart:.2} σ, off {off:.4}; half, 90 and 99 % of directions within {:.4?}, by Mitsuba {:.4?}, evaluators apart {:.1e}",
        case.seed,
        case.law,
        if case.over_tcp { "TCP" } else { "ptys" },
        kept.len(),
        all.as_secs_f64(),
        took.as_secs_f64(),
        errors.ours,
        errors.mitsuba,
        errors.evaluators
    );
    assert_eq!(kills, case.kills);
    assert_eq!(values, case.directions as usize);
    assert!(off < 0.03, "{off}");
    assert!(apart.is_nan() || apart < 5.0, "{apart}");
    assert!(errors.evaluators.is_nan() || errors.evaluators < 1e-2, "{}", errors.evaluators);
    for [_, most, nearly_all] in [errors.ours, errors.mitsuba] {
        let good = most.is_nan() || (most < 0.03 && nearly_all < 0.1);
        assert!(good, "{:?} {:?}", errors.ours, errors.mitsuba);
    }
    let ([_, most, nearly_all], [_, _, theirs]) = (errors.ours, errors.mitsuba);
    [apart, off, most, nearly_all, theirs, errors.evaluators]
}
