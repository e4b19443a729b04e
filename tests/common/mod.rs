//! Common parts of the program's tests: a folder of its own for each, and the program run in it.

#![allow(dead_code, reason = "each test binary uses its part")]
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

pub mod browser;
pub mod hostile;
pub mod indi;
pub mod night;
pub mod star_of_now;
pub mod tagged;
pub mod virtual_night;

pub mod star_night;

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};

/// A star that most tests ask for.
pub const VEGA: [&str; 6] = ["star", "Vega", "--station", "ufo", "--at", "2020-11-18T18:00:00"];

/// The instruments of a night that is planned: a `NIGHT.toml` without visits.
pub const DEVICES: &str = r#"# The instruments.
station = "ufo"

[[camera]]
name = "cam"
device = "sim-camera"
exposure_s = 0.5
interval_s = 2.0

[[counter]]
name = "tagger"
device = "sim-timetagger"
channels = { id400 = 1, spcm = 2, mppc = 3 }
bin_s = 0.1
"#;

/// A scene: a diffuse sphere on the orbit that many texts print, over the built-in station.
pub const SPHERE_PASS: &str = r#"
[target]
sphere = { radius_m = 0.5, material = "white" }
[orbit]
lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]
[station]
name = "ufo"
[times]
from = 2008-09-21T18:45:00Z
to = 2008-09-21T18:52:00Z
step_s = 20
"#;

/// The TOML of a page of `docs/` that holds `key`.
pub fn page_toml(page: &str, key: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("docs").join(page);
    let text = std::fs::read_to_string(path).unwrap();
    let blocks = text.split("```toml\n").skip(1).map(|block| block.split("```").next().unwrap());
    let found = blocks.into_iter().find(|block| block.contains(key));
    found.unwrap_or_else(|| panic!("{page} has no TOML with {key}")).to_owned()
}

/// A light curve of 300 s in the channel `spcm`: two unlike lobes a turn of 20 s, a ripple in place of noise.
pub fn turning_curve() -> String {
    let mut text = String::from(
        "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: time_utc, datatype: string}\n# - {name: exposure_s, unit: s, datatype: float64}\n\
         # - {name: spcm_rate_hz, unit: Hz, datatype: float64}\n# - {name: spcm_sigma_hz, unit: Hz, datatype: float64}\n# - {name: spcm_flags, datatype: int64}\n\
         # - {name: zenith_deg, unit: deg, datatype: float64}\n# meta: {quantity: linear, flag_bits: {}}\n# schema: astropy-2.0\n\
         time_utc exposure_s spcm_rate_hz spcm_sigma_hz spcm_flags zenith_deg\n",
    );
    for i in 0..600 {
        let t = 0.25 + 0.5 * f64::from(i);
        let lobe = |at: f64, width: f64| {
            (width * ((std::f64::consts::TAU * (t / 20.0 - at)).cos() - 1.0)).exp()
        };
        // The fraction of a product with an irrational number: even over 0 to 1, never the same.
        let ripple = (f64::from(i * i) * 0.618_033_988_75).fract() - 0.5;
        let rate = 1e4 * (1.0 + lobe(0.1, 8.0) + 0.5 * lobe(0.6, 15.0) + 0.05 * ripple);
        text += &format!(
            "2008-09-21T18:{:02}:{:06.3} 0.1 {rate:.3} 150 0 40\n",
            46 + (t / 60.0) as u32,
            t % 60.0
        );
    }
    text
}

/// Takes out of a summary what tells files and seconds apart, not light.
pub fn same_light(mut value: serde_json::Value) -> serde_json::Value {
    fn strip(value: &mut serde_json::Value) {
        match value {
            serde_json::Value::Object(map) => {
                map.retain(|key, _| {
                    !matches!(key.as_str(), "sha256" | "inputs" | "provenance" | "created" | "cost")
                        && !key.contains("seconds")
                });
                map.values_mut().for_each(strip);
            }
            serde_json::Value::Array(all) => all.iter_mut().for_each(strip),
            _ => {}
        }
    }
    strip(&mut value);
    value
}

/// A folder with the program as `sunglint`: the one without OpenCV where there are two, since it starts at once.
pub fn programs() -> PathBuf {
    let Some(plain) = option_env!("CARGO_BIN_EXE_sunglint-plain") else {
        return Path::new(env!("CARGO_BIN_EXE_sunglint")).parent().unwrap().to_owned();
    };
    static MADE: OnceLock<PathBuf> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("programs");
        std::fs::create_dir_all(&folder).unwrap();
        // Another run of the tests may do the same at this moment.
        let own = folder.join(format!("sunglint-{}", std::process::id()));
        let _ = std::fs::remove_file(&own);
        std::os::unix::fs::symlink(plain, &own).unwrap();
        std::fs::rename(&own, folder.join("sunglint")).unwrap();
        folder
    });
    made.clone()
}

/// The program: see [`programs`].
pub fn program() -> PathBuf {
    programs().join("sunglint")
}

/// A folder of its own for each test, gone at its end; and the program that is run there.
pub struct Folder(pub PathBuf, PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        // Tests of all files run in one process, and two may have chosen the same name.
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let own = format!("sunglint-{name}-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(own);
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path, program())
    }

    /// A folder for the program with OpenCV.
    #[cfg(feature = "opencv")]
    pub fn with_opencv(name: &str) -> Self {
        let mut made = Self::new(name);
        made.1 = env!("CARGO_BIN_EXE_sunglint").into();
        made
    }

    pub fn run(&self, arguments: &[&str]) -> Output {
        Command::new(&self.1)
            .args(arguments)
            .current_dir(&self.0)
            .env_remove("SUNGLINT_STATION")
            .output()
            .unwrap()
    }

    /// Runs what must succeed, and gives its stdout.
    pub fn done(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert_eq!(
            output.status.code(),
            Some(0),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout).unwrap()
    }

    /// Runs what must fail with this code, and gives its stderr.
    pub fn refused(&self, code: i32, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
        assert!(output.stdout.is_empty(), "{arguments:?} printed a result and failed");
        message
    }

    pub fn json(&self, arguments: &[&str]) -> Value {
        serde_json::from_str(&self.done(arguments)).unwrap()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Puts the demonstration into a folder under the name that it was given where it was made, `sunglint-demo-2`, since `sunglint-demo` was taken: `sunglint demo --json` runs once for the tests that
/// begin with it. Returns what it printed.
pub fn demonstration(folder: &Folder) -> &'static Value {
    type Made = (Vec<(PathBuf, Vec<u8>)>, Value);
    static MADE: OnceLock<Made> = OnceLock::new();
    let (files, printed) = MADE.get_or_init(|| {
        let folder = Folder::new("demonstration");
        std::fs::create_dir(folder.path("sunglint-demo")).unwrap();
        let printed = folder.json(&["demo", "--json"]);
        let mut files = Vec::new();
        gather(&folder.0, Path::new("sunglint-demo-2"), &mut files);
        (files, printed)
    });
    for (name, bytes) in files {
        let path = folder.0.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    printed
}

/// All files below a folder, which is in another.
fn gather(above: &Path, name: &Path, files: &mut Vec<(PathBuf, Vec<u8>)>) {
    for entry in std::fs::read_dir(above.join(name)).unwrap() {
        let entry = entry.unwrap();
        let name = name.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            gather(above, &name, files);
        } else {
            files.push((name, std::fs::read(entry.path()).unwrap()));
        }
    }
}

/// Writes a scene, `stage.toml`, of a cylinder that tumbles in 21.7 s about an axis at 120°, +35° (synthetic), and the curves of the longest of its passes, at most six. Returns their names.
pub fn tumbling_stage(folder: &Folder, passes: usize) -> Vec<String> {
    let elements = "ISS (ZARYA)\n1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n";
    std::fs::write(folder.path("stage.tle"), elements).unwrap();
    let scene = "name = \"stage\"\n[target]\nname = \"stage\"\n[[target.part]]\nname = \"tank\"\nshape = \"cylinder\"\nradius_m = 1.0\nheight_m = 7.0\nmaterial = \"white\"\n\
        [orbit]\ntle = \"stage.tle\"\nnorad_id = 25544\n[attitude]\nlaw = \"spin\"\naxis_body = [1, 0, 0]\naxis_ra_dec_deg = [120, 35]\nphase_deg = 0\nperiod_s = 21.7\n\
        epoch_utc = 2008-09-21T00:00:00Z\n[station]\nname = \"ufo\"\n[times]\nfrom = 2008-09-21T18:43:47Z\nto = 2008-09-21T18:53:47Z\nstep_s = 0.5\nexposure_s = 0.1\n";
    std::fs::write(folder.path("stage.toml"), scene).unwrap();
    let all = [
        ("2008-09-26T17:47:58", "2008-09-26T17:53:51"),
        ("2008-09-23T18:03:45", "2008-09-23T18:09:04"),
        ("2008-09-24T18:30:08", "2008-09-24T18:34:40"),
        ("2008-09-25T18:56:51", "2008-09-25T19:00:12"),
        ("2008-09-21T18:46:00", "2008-09-21T18:49:09"),
        ("2008-09-22T19:12:20", "2008-09-22T19:14:59"),
    ];
    let names: Vec<String> = (1..=passes).map(|k| format!("night{k}.ecsv")).collect();
    for ((from, to), name) in all.iter().zip(&names) {
        let times = ["--from", from, "--to", to, "--tolerance", "1e-2"];
        folder.done(&[&["simulate", "stage.toml", "-q", "-o", name][..], &times].concat());
    }
    names
}
