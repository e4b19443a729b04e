//! The page in a real browser: a recorded session, a night that runs and is steered, a server that goes and comes back; and a night of ten hours.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::browser::Browser;
use crate::common::night::{Recording, at, bins, frame};
use crate::common::{DEVICES, Folder};
use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use sunglint_formats::session::{Session, What};
use sunglint_formats::time::format_utc;

/// A program that serves a page, ended with the test.
pub(crate) struct Serving {
    pub(crate) child: Child,
    /// Address with the token, where there is one.
    pub(crate) url: String,
    /// Lines of its standard error before the address.
    pub(crate) said: String,
}

impl Serving {
    pub(crate) fn start(folder: &Folder, arguments: &[&str]) -> Self {
        Self::with(folder, arguments, &[])
    }

    /// Observes `night.toml` into `session` in real time, with a page.
    pub(crate) fn observe(folder: &Folder, more: &[&str]) -> Self {
        let arguments = ["observe", "night.toml", "-o", "session", "--real-time", "--page"];
        Self::start(folder, &[&arguments[..], &["127.0.0.1:0"], more].concat())
    }

    /// The program with these variables of the environment, too.
    fn with(folder: &Folder, arguments: &[&str], variables: &[(&str, &str)]) -> Self {
        let mut child = Command::new(crate::common::program())
            .args(arguments)
            .current_dir(&folder.0)
            .env_remove("SUNGLINT_STATION")
            .envs(variables.iter().copied())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let mut said = String::new();
        let url = loop {
            let Some(Ok(line)) = lines.next() else { panic!("it ended: {said}") };
            if let Some(url) = line.strip_prefix("page: ") {
                break url.to_owned();
            }
            said += &line;
        };
        // Somebody goes on reading, or the pipe fills.
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, url, said }
    }

    fn host(&self) -> String {
        let rest = self.url.strip_prefix("http://").unwrap();
        rest.split('/').next().unwrap().to_owned()
    }

    /// An answer of the program, by plain TCP.
    fn get(&self, path: &str) -> (u16, Vec<u8>) {
        let host = self.host();
        let mut stream = TcpStream::connect(&host).unwrap();
        let request = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let head = answer.windows(4).position(|part| part == b"\r\n\r\n").unwrap();
        let status = std::str::from_utf8(&answer[9..12]).unwrap().parse().unwrap();
        (status, answer[head + 4..].to_vec())
    }

    pub(crate) fn json(&self, path: &str) -> Value {
        let (status, body) = self.get(path);
        assert_eq!(status, 200, "{path}: {}", String::from_utf8_lossy(&body));
        serde_json::from_slice(&body).unwrap()
    }

    /// Time of the processor that the page's threads have taken, s.
    pub(crate) fn page_cpu_s(&self) -> f64 {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.child.id())).unwrap();
        let ticks = |task: std::fs::DirEntry| {
            let stat = std::fs::read_to_string(task.path().join("stat")).ok()?;
            let (name, rest) = stat.rsplit_once(") ")?;
            let fields: Vec<&str> = rest.split(' ').collect();
            let own = name.ends_with("(page") || name.ends_with("(page-answer");
            Some(if own {
                fields[11].parse::<f64>().ok()? + fields[12].parse::<f64>().ok()?
            } else {
                0.0
            })
        };
        // A hundred ticks a second on every Linux that we know.
        tasks.flatten().filter_map(ticks).sum::<f64>() / 100.0
    }

    pub(crate) fn interrupt(&mut self) -> Option<i32> {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        self.child.wait().unwrap().code()
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Where pictures of the page go, for people to look at.
pub(crate) fn pictures() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("page");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Elements whose text is cut off, and pairs of elements that lie over one another; and how much wider the page is than its window.
const LAYOUT: &str = "(() => {
  const seen = (e) => { const r = e.getBoundingClientRect(); return r.width > 1 && r.height > 1 && !e.closest('.skip') && getComputedStyle(e).visibility === 'visible'; };
  const cut = [...document.querySelectorAll('button, label, h1, h2, td, th, p, li, dt, dd, span, caption')].filter(seen)
    .filter((e) => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== 'inline').map((e) => e.outerHTML.slice(0, 90));
  const over = [];
  for (const group of ['header > *, header .tools > *', 'main > *', '.image > *', '.counts > *', '.state > *', '.log > *', 'footer > *', '.image .head > *', '.counts .head > *']) {
    const all = [...document.querySelectorAll(group)].filter(seen);
    for (const a of all) for (const b of all) if (a !== b && !a.contains(b) && !b.contains(a) && getComputedStyle(a).position !== 'fixed' && getComputedStyle(b).position !== 'fixed') {
      const [r, s] = [a.getBoundingClientRect(), b.getBoundingClientRect()];
      if (Math.min(r.right, s.right) - Math.max(r.left, s.left) > 1 && Math.min(r.bottom, s.bottom) - Math.max(r.top, s.top) > 1) over.push(a.outerHTML.slice(0, 60) + ' over ' + b.outerHTML.slice(0, 60));
    }
  }
  const bare = [...document.querySelectorAll('button, input, select, canvas[tabindex]')].filter(seen)
    .filter((e) => !(e.labels?.length || e.textContent.trim() || e.getAttribute('aria-label'))).map((e) => e.outerHTML.slice(0, 90));
  return { cut, over, bare, wider: document.documentElement.scrollWidth - innerWidth };
})()";

/// Contrast of every text with what lies behind it, at least as WCAG 2 AA asks; and whether red light has any other colour in it.
const COLOURS: &str = "(() => {
  const parse = (text) => text.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => [r, g, b].map((v) => v / 255).map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4).reduce((s, v, i) => s + v * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = (e) => { for (; e; e = e.parentElement) { const c = parse(getComputedStyle(e).backgroundColor); if (c.length < 4 || c[3] > 0.99) return c; } return [255, 255, 255]; };
  const poor = [], other = [];
  for (const e of document.querySelectorAll('body, body *')) {
    const r = e.getBoundingClientRect();
    if (r.width < 2 || r.height < 2 || e.closest('.skip, option') || e.disabled) continue;
    const style = getComputedStyle(e);
    for (const key of ['color', 'backgroundColor', 'borderTopColor']) { const c = parse(style[key]); if ((c[3] ?? 1) > 0 && (c[1] > 0.45 * c[0] || c[2] > 0.45 * c[0]) && c[1] + c[2] > 12) other.push(e.tagName + '#' + e.id + ' ' + key + ' ' + style[key]); }
    if (![...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim())) continue;
    const [a, b] = [light(parse(style.color)), light(behind(e))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) poor.push(ratio.toFixed(2) + ' ' + e.outerHTML.slice(0, 70));
  }
  return { poor, other };
})()";

/// Looks at all sizes and colours, and keeps a picture of each.
pub(crate) fn looks_good(browser: &mut Browser, name: &str) {
    for (width, height) in [(400, 800), (1280, 900), (2560, 1440)] {
        browser.size(width, height);
        for mode in ["light", "dark", "red"] {
            browser.run(&format!("(() => {{ const t = document.getElementById('theme'); t.value = '{mode}'; t.dispatchEvent(new Event('change')); }})()"));
            browser.settle();
            browser.settle();
            let layout = browser.run(LAYOUT);
            let empty = json!({"cut": [], "over": [], "bare": [], "wider": 0});
            assert_eq!(layout, empty, "{name} at {width} px, {mode}");
            let colours = browser.run(COLOURS);
            assert_eq!(colours["poor"], json!([]), "{name}, {mode}");
            if mode == "red" {
                assert_eq!(colours["other"], json!([]), "{name}");
            }
            // As wide as a telephone and as a laptop.
            if width < 2000
                && let Some(found) = browser.axe("axe_core_on_the_page")
            {
                assert_eq!(found, json!([]), "{name} at {width} px, {mode}");
            }
            browser.shot(&pictures().join(format!("{name}_{width}_{mode}.png")));
        }
    }
    browser.size(1280, 900);
}

/// A session whose names are markup.
fn hostile_session(folder: &Folder) -> Session {
    let session = Recording { seconds: 120.0, frame_px: 120, ..Recording::default() }
        .write(&folder.0.join("night"));
    let log = session.root().join("events.jsonl");
    let text = std::fs::read_to_string(&log).unwrap();
    let name = r#"<img src=x onerror=alert(1)><b>Vega</b>"#;
    let note = r#"{"utc":"2020-11-18T17:00:30Z","kind":"control","action":"note","text":"<script>alert(2)</script>"}"#;
    let lost = r#"{"utc":"2020-11-18T17:00:40Z","kind":"device_lost","device":"cam","error":"no cable","again_in_s":1.0}"#;
    let mut lines: Vec<String> =
        text.lines().map(|line| line.replace("\"Vega\"", &json!(name).to_string())).collect();
    lines.insert(lines.len() - 2, note.into());
    lines.insert(lines.len() - 2, lost.into());
    std::fs::write(&log, lines.join("\n") + "\n").unwrap();
    session
}

/// Truth: the session's own files, read by the library: pixels, counts, times of visits and frames that the page shows; names of targets and notes are text.
#[test]
fn a_recorded_session_in_a_browser() {
    let Some(mut browser) = Browser::start("a_recorded_session_in_a_browser") else { return };
    let folder = Folder::new("page-recorded");
    let session = hostile_session(&folder);
    let mut serving =
        Serving::start(&folder, &["page", "night", "--no-open", "--address", "127.0.0.1:0"]);
    assert!(serving.url.contains("#token="), "{}", serving.url);
    browser.open(&serving.url);
    // The first frame of Vega's visit, which begins at 48 s.
    browser.until("sunglint.frame?.header.number === 50");
    assert_eq!(browser.text("#name"), "night");
    let frame = session.frames("cam").unwrap().files[49].read().unwrap();
    let pixels: Vec<Value> = frame.pixels.iter().map(|p| json!(p)).collect();
    assert_eq!(browser.run("Array.from(sunglint.frame.pixels)"), Value::Array(pixels));
    // Every bin of the visit, where all fit.
    browser.until("sunglint.shown?.bins === 1");
    let all = bins(&session);
    let found =
        browser.run("[sunglint.shown.start_s, sunglint.shown.rate_hz[1], sunglint.shown.flags]");
    let first = (found[0][0].as_f64().unwrap() * 10.0).round() as usize;
    assert!(first < 480 && found[0].as_array().unwrap().len() > 1000);
    for (i, rate) in found[1].as_array().unwrap().iter().enumerate() {
        let bin = &all[first + i];
        assert!((rate.as_f64().unwrap() - 10.0 * bin.counts[1] as f64).abs() < 1e-6);
        assert_eq!(found[2][i], bin.flags.bits());
    }
    // Names are text.
    let target = "<img src=x onerror=alert(1)><b>Vega</b>";
    assert!(browser.text("#target").starts_with(target), "{}", browser.text("#target"));
    assert!(browser.text("#events").contains("note: <script>alert(2)</script>"));
    assert_eq!(browser.run("document.querySelectorAll('main img, main b, main script').length"), 0);
    // A pixel under the pointer.
    let script = "(() => { const e = document.getElementById('image'); const r = e.getBoundingClientRect(); return [r.left + r.width * 10.5 / 120, r.top + r.height * 20.5 / 120]; })()";
    let place = browser.run(script);
    let moved = json!({"type": "mouseMoved", "x": place[0], "y": place[1]});
    browser.call("Input.dispatchMouseEvent", moved);
    browser.settle();
    let expected = format!("column 10, row 20: {} ADU", frame.pixels[[20, 10]]);
    assert_eq!(browser.text("#pixel"), expected);
    // Keys: one frame on, one back, the end; the device that was lost at 40 s.
    browser.run("document.activeElement.blur()");
    browser.key("ArrowRight");
    browser.until("sunglint.frame.header.number === 51");
    browser.key("ArrowLeft");
    browser.until("sunglint.frame.header.number === 50");
    browser.until("document.querySelector('#devices tbody').innerText.includes('lost')");
    browser.key("Home");
    browser.until("sunglint.frame.header.number === 1");
    browser.until("!document.querySelector('#devices tbody').innerText.includes('lost')");
    // A film at ×100 passes a minute in well under two seconds.
    browser.run("(() => { const s = document.getElementById('speed'); s.value = '100'; })()");
    browser.click("#play");
    browser.until("sunglint.t > 60");
    browser.until("sunglint.t === sunglint.about.length_s && !sunglint.playing");
    for stretch in ["linear", "zscale", "asinh"] {
        browser.run(&format!("(() => {{ const s = document.getElementById('stretch'); s.value = '{stretch}'; s.dispatchEvent(new Event('change')); }})()"));
    }
    browser.click("#visits tbody tr:nth-child(2) button");
    browser.until("Math.abs(sunglint.t - 48) < 1e-6");
    browser.until("sunglint.sky?.target?.[1][1] > 30");
    looks_good(&mut browser, "recorded");
    assert_eq!(browser.complaints, Vec::<String>::new());
    // Of all sources one is marked; the line below tells how many there are.
    browser.click("#sources");
    browser.until("/ · \\d+ sources/.test(document.getElementById('measured').innerText)");
    // Were a text ever taken for markup, the browser would refuse it.
    let policy = browser.run("['innerHTML', 'script'].map((how) => { try { if (how === 'script') { const s = document.createElement('script'); s.text = 'window.bad = 1'; document.body.append(s); } else document.body.innerHTML = '<b>x</b>'; return 'taken'; } catch (error) { return error.name; } })");
    assert_eq!(policy, json!(["TypeError", "TypeError"]));
    assert_eq!(browser.run("typeof window.bad"), "undefined");
    assert_eq!(serving.interrupt(), Some(0));
    // A control is refused: nothing here can be steered.
    let message = folder.refused(1, &["page", "nowhere", "--no-open"]);
    assert!(message.contains("nowhere"), "{message}");
    let message = folder.refused(2, &["page", "night", "--no-open", "--address", "here:x"]);
    assert!(message.contains("127.0.0.1:8650"), "{message}");
}

/// The same zscale as astropy's, on the page. Truth: astropy 7's `ZScaleInterval` (its own implementation of IRAF's rule), to a thousandth of the range: it samples alike.
#[test]
fn zscale_is_astropys() {
    let test = "zscale_is_astropys";
    let Some(python) = sunglint_testkit::peer_python(test, &["astropy"]) else { return };
    let Some(mut browser) = Browser::start(test) else { return };
    let folder = Folder::new("page-zscale");
    Recording { frame_px: 16, ..Recording::default() }.write(&folder.0.join("night"));
    let serving =
        Serving::start(&folder, &["page", "night", "--no-open", "--address", "127.0.0.1:0"]);
    browser.open(&serving.url);
    let script = "import json, numpy as np\nfrom astropy.visualization import ZScaleInterval\nout = []\n\
        for seed in range(5):\n r = np.random.default_rng(seed)\n a = r.normal(500 + 100 * seed, 10, (200, 200)).clip(0).round()\n\
        \x20a[90:110, 90:110] += 5000\n a += np.arange(200) * seed\n\
        \x20out.append([a.ravel().tolist(), [float(v) for v in ZScaleInterval().get_limits(a)]])\nprint(json.dumps(out))";
    let cases: Value =
        serde_json::from_str(&sunglint_testkit::run_python(&python, script, &[])).unwrap();
    for case in cases.as_array().unwrap() {
        let found = browser.run(&format!(
            "import('/page.js').then((page) => page.zscale(Uint16Array.from({})))",
            case[0]
        ));
        let [low, high] = [0, 1].map(|i| case[1][i].as_f64().unwrap());
        for i in [0, 1] {
            let (found, expected) = (found[i].as_f64().unwrap(), case[1][i].as_f64().unwrap());
            assert!((found - expected).abs() < 1e-3 * (high - low), "{found} for {expected}");
        }
    }
}

/// Writes a session of ten hours: 360,000 bins, 18,000 frames, 144,000 marks in the log.
pub(crate) fn ten_hours(folder: &Folder) {
    let root = folder.0.join("night");
    Recording { seconds: 36_000.0, frame_s: 1e6, frame_px: 200, ..Recording::default() }
        .write(&root);
    let manifest = root.join("session.toml");
    let text = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&manifest, text.replace("exposure_s = 500000.0", "exposure_s = 0.5")).unwrap();
    // One frame under the names of all.
    let one = folder.path("one.fits");
    frame(at(0.0), 0.5, 200, 1)
        .write_file(&one, sunglint_formats::atomic::Overwrite::Refuse)
        .unwrap();
    for i in 0..18_000_u32 {
        let start = at(2.0 * f64::from(i));
        let utc: String =
            format_utc(start, 6).chars().filter(|c| !matches!(c, '-' | ':')).collect();
        let hour = root.join("frames/cam").join(&utc[9..11]);
        if !hour.exists() {
            std::fs::create_dir_all(&hour).unwrap();
        }
        std::fs::hard_link(&one, hour.join(format!("{utc}_{:08}.fits", i + 1))).unwrap();
    }
    let log = root.join("events.jsonl");
    let text = std::fs::read_to_string(&log).unwrap();
    let (first, end) = text.trim_end().rsplit_once('\n').unwrap();
    let mut lines = first.to_owned() + "\n";
    for i in 0..144_000_u32 {
        let utc = format_utc(at(0.25 * f64::from(i)), 2);
        lines += &format!(
            "{{\"utc\":\"{utc}\",\"kind\":\"sync\",\"files\":[{{\"file\":\"counts/tagger.ecsv\",\"bytes\":{i},\"rows\":{i},\"crc32\":7}},{{\"file\":\"events.jsonl\",\"bytes\":{i},\"rows\":{i},\"crc32\":7}}]}}\n"
        );
    }
    std::fs::write(&log, lines + end + "\n").unwrap();
}

/// A night of ten hours costs no more to look at than a short one. Truth: what the page asks of the program: one frame, its marks, the counts and the sky for each place that is sought; the counts are
/// the bins' own numbers. How long it takes is in `campaign_page`.
#[test]
fn ten_hours_open_at_once() {
    let folder = Folder::new("page-long");
    ten_hours(&folder);
    let serving =
        Serving::start(&folder, &["page", "night", "--no-open", "--address", "127.0.0.1:0"]);
    let about = serving.json("/api/about");
    assert_eq!(about["length_s"], 36_000.0);
    assert_eq!(
        (&about["devices"][0]["taken"], &about["devices"][1]["taken"]),
        (&json!(18_000), &json!(360_000))
    );
    for k in 0..20_u32 {
        let at_s = f64::from(k * 7919 % 36_000);
        let counts = serving
            .json(&format!("/api/counts/tagger?from_s={at_s}&to_s={}&points=1000", at_s + 60.0));
        let (status, frame) = serving.get(&format!("/api/frame/cam/{}", (at_s / 2.0) as u32));
        assert_eq!((status, frame.len() > 80_000), (200, true));
        let rates = counts["rate_hz"][0].as_array().unwrap();
        // Truth: the bin's number is its count (`night::bin`).
        let first = (counts["start_s"][0].as_f64().unwrap() * 10.0).round();
        assert_eq!(rates[0].as_f64().unwrap().round(), first * 10.0);
        assert!(rates.len() <= 2000, "{}", rates.len());
    }
    let whole = serving.json("/api/counts/tagger?points=2000");
    assert!(whole["start_s"].as_array().unwrap().len() <= 2000);
    let Some(mut browser) = Browser::start("ten_hours_open_at_once") else { return };
    browser.open(&serving.url);
    browser.until("sunglint.frame !== null && sunglint.sky !== null");
    browser.run("(() => { const s = document.getElementById('span'); s.value = '60'; s.dispatchEvent(new Event('change')); })()");
    browser.until("sunglint.shown?.span < 61");
    let asked = "performance.getEntriesByType('resource').filter((e) => e.name.includes('/api/')).map((e) => e.name.split('/api/')[1].split(/[/?]/)[0]).sort()";
    for t in [30_000.0, 100.0, 17_000.5] {
        std::thread::sleep(Duration::from_millis(500));
        browser.run("performance.clearResourceTimings()");
        let script = format!(
            "(() => {{ const s = document.getElementById('slider'); s.value = '{t}'; s.dispatchEvent(new Event('input')); }})()"
        );
        browser.run(&script);
        let number = (t / 2.0) as u32;
        browser.until(&format!("sunglint.frame?.of === {number} && sunglint.marks?.of === {number} && Math.abs((sunglint.sky?.at_s ?? -9) - {t}) < 1"));
        std::thread::sleep(Duration::from_millis(500));
        assert_eq!(browser.run(asked), json!(["counts", "frame", "marks", "sky"]));
    }
}

pub(crate) const LIVE_PLAN: &str = r#"
station = "ufo"
for_s = 600

[[camera]]
name = "cam"
device = "sim-camera"
exposure_s = 0.1
interval_s = 0.3

[[counter]]
name = "tagger"
device = "sim-timetagger"
channels = { g = 1, r = 3 }
bin_s = 0.1

[[visit]]
off = "sky"
for_s = 300

[[visit]]
star = "Polaris"
for_s = 300
"#;

fn controls(session: &Session) -> Vec<(String, String)> {
    let events = session.events().unwrap().map(|event| event.unwrap().what);
    let one = |what| match what {
        What::Control { action, text } => Some((action, text)),
        _ => None,
    };
    events.filter_map(one).collect()
}

fn targets(session: &Session) -> Vec<String> {
    let events = session.events().unwrap().map(|event| event.unwrap().what);
    let one = |what| match what {
        What::Target(target) => Some(target.name),
        _ => None,
    };
    events.filter_map(one).collect()
}

/// 1,000 clients that say nothing, say it slowly, or ask for frames that they never take.
pub(crate) fn clients(serving: &Serving) -> Vec<TcpStream> {
    let host = serving.host();
    let said = |i: usize| match i % 4 {
        0 | 1 => String::new(),
        2 => format!("GET /api/about HTTP/1.1\r\nHost: {host}\r\nX"),
        _ => format!("GET /api/frame/cam HTTP/1.1\r\nHost: {host}\r\n\r\n").repeat(20),
    };
    let client = |i: usize| {
        let mut stream = TcpStream::connect(&host).ok()?;
        // A client that was shown out already is one, too.
        let _ = stream.write_all(said(i).as_bytes());
        Some(stream)
    };
    let all: Vec<TcpStream> = (0..1000).filter_map(client).collect();
    assert!(all.len() > 900, "{}", all.len());
    all
}

/// Stop is on the screen, and under nothing, wherever somebody looks: at the top, in the middle and at the end of the page, on a telephone and on a laptop.
fn stop_is_in_reach(browser: &mut Browser) {
    for (width, height) in [(400, 800), (1280, 900), (2560, 1440)] {
        browser.size(width, height);
        for part in ["0", "0.5", "1"] {
            let script = format!(
                "(async () => {{ scrollTo(0, {part} * document.documentElement.scrollHeight); await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
                 const b = document.getElementById('stop'); const r = b.getBoundingClientRect(); return b.contains(document.elementFromPoint(r.left + r.width / 2, r.top + r.height / 2)); }})()"
            );
            assert_eq!(browser.run(&script), true, "{width} px, at {part}");
        }
    }
    browser.size(1280, 900);
}

/// The sky of a running night six hours ahead, and what lies under the pointer. Truth: the sky turns about the pole by 15.04107° an hour of UTC (24 h / 23 h 56 min 4.09 s): each star that is up
/// both times stands there, to 0.1° (six hours of precession and aberration are some arcseconds). The formula that turns it is held to closed forms: the equator's points, the zenith, the pole.
fn the_sky_ahead(browser: &mut Browser) {
    let at = browser.run("import('/page.js').then((page) => [page.horizontal(48.78, 90, 0), page.horizontal(48.78, 0, 48.78), page.horizontal(48.78, 37, 90)])");
    for (k, truth) in [[270.0, 0.0], [f64::NAN, 90.0], [0.0, 48.78]].iter().enumerate() {
        for i in 0..2 {
            let found = at[k][i].as_f64().unwrap();
            let off = (found - truth[i] + 180.0).rem_euclid(360.0) - 180.0;
            // The square root of the rounding at the zenith.
            assert!(truth[i].is_nan() || off.abs() < 1e-5, "{k}: {at}");
        }
    }
    let stars = "sunglint.sky.stars.map((s) => [s.plan_name, ...s.at_deg])";
    let table = |value: &Value| -> Vec<(String, [f64; 2])> {
        let of = |row: &Value| (row[0].to_string(), [1, 2].map(|i| row[i].as_f64().unwrap()));
        value.as_array().unwrap().iter().map(of).collect()
    };
    let before = browser.run(&format!("[sunglint.sky.at_s, {stars}]"));
    browser.run("(() => { const s = document.getElementById('ahead'); s.value = '21600'; s.dispatchEvent(new Event('input')); })()");
    browser.until("sunglint.sky.at_s - sunglint.live.now_s > 21500");
    assert!(browser.text("#sky-text").contains("in 6 h 00 min"), "{}", browser.text("#sky-text"));
    let after = browser.run(&format!("[sunglint.sky.at_s, {stars}]"));
    let turned = 15.041_07 / 3600.0 * (after[0].as_f64().unwrap() - before[0].as_f64().unwrap());
    let latitude = 48.7822_f64.to_radians();
    let (then, mut seen) = (table(&after[1]), 0);
    for (name, [azimuth, altitude]) in table(&before[1]) {
        let Some((_, found)) = then.iter().find(|(other, _)| *other == name) else { continue };
        let (a, h) = (azimuth.to_radians(), altitude.to_radians());
        let sin_d = latitude.sin() * h.sin() + latitude.cos() * h.cos() * a.cos();
        let hour = (-h.cos() * a.sin())
            .atan2(latitude.cos() * h.sin() - latitude.sin() * h.cos() * a.cos());
        let (hour, d) = (hour + f64::to_radians(turned), sin_d.asin());
        let up = latitude.sin() * d.sin() + latitude.cos() * d.cos() * hour.cos();
        let north = latitude.cos() * d.sin() - latitude.sin() * d.cos() * hour.cos();
        let truth = [(-d.cos() * hour.sin()).atan2(north), up.asin()];
        let around = (found[0] - truth[0].to_degrees() + 180.0).rem_euclid(360.0) - 180.0;
        let off = (around * truth[1].cos()).hypot(found[1] - truth[1].to_degrees());
        assert!(off < 0.1, "{name}: {found:?}, off by {off}°");
        seen += 1;
    }
    assert!(seen > 20, "{seen}");
    // Under the pointer: the name of a star.
    let star = browser.run("(() => { const e = document.getElementById('sky'); e.scrollIntoView({block: 'center'}); const r = e.getBoundingClientRect(); const far = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
        const s = sunglint.sky.stars.find((s) => s.name && s.at_deg[1] > 10 && sunglint.sky.stars.every((o) => o === s || far(sunglint.place(o.at_deg), sunglint.place(s.at_deg)) > 30)); const [x, y] = sunglint.place(s.at_deg); return [s.name, r.left + x, r.top + y]; })()");
    let moved = json!({"type": "mouseMoved", "x": star[1], "y": star[2]});
    browser.call("Input.dispatchMouseEvent", moved);
    browser.settle();
    let said = browser.text("#sky-text");
    assert!(said.starts_with(star[0].as_str().unwrap()), "{said} for {star}");
    browser.run("(() => { const s = document.getElementById('ahead'); s.value = '0'; s.dispatchEvent(new Event('input')); })()");
    browser.until("Math.abs(sunglint.sky.at_s - sunglint.live.now_s) < 10");
}

/// A night that runs, looked at and steered by clicks. Truth: the session that it leaves: every click is an event of its log, in order, and the targets change by them; it is whole, no bin is
/// missing though a page and 1,000 silent or slow clients look on. What the page's threads cost is in `campaign_page`.
#[test]
fn a_night_is_steered_from_the_page() {
    let Some(mut browser) = Browser::start("a_night_is_steered_from_the_page") else { return };
    let folder = Folder::new("page-live");
    // Nothing answers at the focuser's address.
    let focuser =
        "interval_s = 0.3\nfocuser = { device = \"alpaca-focuser:127.0.0.1:1/0\", step = 500 }";
    let plan = LIVE_PLAN.replace("interval_s = 0.3", focuser);
    std::fs::write(folder.path("night.toml"), plan).unwrap();
    let arguments = ["observe", "night.toml", "-o", "session", "--anyway", "--page", "127.0.0.1:0"];
    let mut serving = Serving::start(&folder, &arguments);
    let _held = clients(&serving);
    browser.open(&serving.url);
    assert_eq!(browser.run("location.hash"), "", "the token stays in the address");
    browser.until("sunglint.counts.tagger?.start_s.length > 20");
    browser.until("sunglint.frame !== null");
    assert_eq!(browser.text("#mode"), "live");
    assert!(browser.text("#target").starts_with("sky"), "{}", browser.text("#target"));
    assert!(browser.text("#next").contains("Polaris"));
    looks_good(&mut browser, "live");
    stop_is_in_reach(&mut browser);
    the_sky_ahead(&mut browser);
    browser.until("document.querySelector('#disk').innerText.includes('free')");
    // Each bin and each frame that is drawn is a new one.
    let drawn = browser.run(
        "(() => { sunglint.lag = {}; return new Promise(done => setTimeout(() => done(['counts', 'image'].map((key) => sunglint.lag[key].length)), 4000)); })()",
    );
    assert!(drawn.as_array().unwrap().iter().all(|n| n.as_u64() > Some(3)), "{drawn}");
    browser.click("#pause");
    browser.until("document.getElementById('mode').innerText === 'paused'");
    browser.click("#pause");
    browser.until("document.getElementById('mode').innerText === 'live'");
    browser.click("#skip");
    browser.until("document.getElementById('target').innerText.startsWith('Polaris')");
    // Exposure of the next frames, and as planned again.
    let planned = browser.run("sunglint.frame.header.exposure_s").as_f64().unwrap();
    type_into(&mut browser, "#expose-s", "0.05");
    browser.click("#expose-form button");
    browser.until("sunglint.frame.header.exposure_s === 0.05");
    type_into(&mut browser, "#expose-s", "0");
    browser.click("#expose-form button");
    browser.until("document.getElementById('notice').innerText.includes('above 0')");
    type_into(&mut browser, "#expose-s", "");
    type_into(&mut browser, "#expose-gain", "3");
    browser.click("#expose-form button");
    browser
        .until("document.getElementById('notice').innerText.includes('gives this camera no gain')");
    type_into(&mut browser, "#expose-gain", "");
    browser.click("#expose-form button");
    browser.until(&format!("sunglint.frame.header.exposure_s === {planned}"));
    // A focuser that is not there is told of, and the visit goes on. One that is there: observatory/tests/focus.rs.
    browser.click("#focus");
    browser.until("document.getElementById('events').innerText.includes('its focuser: ')");
    browser.until("document.getElementById('mode').innerText === 'live'");
    // A refusal is an answer, and the browser's own log tells of it.
    browser.complaints.retain(|text| !text.contains("422") && !text.contains("409"));
    browser.run("document.getElementById('note').value = '<i>a</i> cloud'");
    browser.click("#note-form button");
    browser.until("document.getElementById('events').innerText.includes('note: <i>a</i> cloud')");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
    // A page without the token shows and steers nothing.
    let bare = serving.url.split('#').next().unwrap().to_owned();
    browser.run("sessionStorage.clear()");
    browser.open(&bare);
    assert_eq!(browser.run("document.getElementById('steer').hidden"), true);
    let refused = "fetch('api/control', {method: 'POST', headers: {'content-type': 'application/json'}, body: '{\"action\":\"stop\"}'}).then(a => a.status)";
    assert_eq!(browser.run(refused), 401);
    // Asleep for a while, as on a laptop whose lid is closed: then back to the present by itself, and it says so; no bin is missing.
    browser.until("sunglint.counts.tagger?.start_s.length > 2");
    browser.call("Page.setWebLifecycleState", json!({"state": "frozen"}));
    std::thread::sleep(Duration::from_secs(6));
    browser.call("Page.setWebLifecycleState", json!({"state": "active"}));
    browser.until("/^back after ([6-9]|\\d\\d) s without the night/.test(document.getElementById('notice').innerText)");
    let gaps = "sunglint.counts.tagger.start_s.filter((t, i, all) => i && t - all[i - 1] > 0.15)";
    assert_eq!(browser.run(gaps), json!([]));
    // Stop is one click.
    let with_token = serving.url.clone();
    browser.open(&with_token);
    browser.complaints.clear();
    browser.click("#stop");
    assert!(serving.child.wait().unwrap().success());
    browser.until("document.getElementById('mode').innerText.startsWith('ended') || document.getElementById('mode').innerText === 'no connection'");
    let session = Session::open(folder.path("session")).unwrap();
    let expected = [
        ("pause", ""),
        ("resume", ""),
        ("skip", ""),
        ("expose", "cam: 0.05 s"),
        ("expose", "cam: as planned"),
        ("focus", "cam"),
        ("note", "<i>a</i> cloud"),
        ("stop", ""),
    ];
    let expected: Vec<_> =
        expected.iter().map(|(a, t)| ((*a).to_owned(), (*t).to_owned())).collect();
    assert_eq!(controls(&session), expected);
    // The order to focus ends at once: whether the night was paused for it is a matter of milliseconds.
    let targets = targets(&session);
    assert_eq!(targets[..4], ["sky", "none", "sky", "Polaris"]);
    assert!(targets[4..].is_empty() || targets[4..] == ["none", "Polaris"], "{targets:?}");
    let report = session.check().unwrap();
    assert!(report.is_whole(), "{:?}", report.findings);
    assert_eq!((report.counters[0].unflagged_gaps, report.counters[0].flagged_gaps), (0, 0));
}

/// A virtual star of the hour over the station, alone, too faint to saturate the camera in a tenth of a second: no scintillation, nothing that crosses.
const DRIVEN: &str = r#"
seed = 7
[plan]
stars = 1
visit_s = 30
sky_s = 5
slew_s = 1
dark_s = 3
v_mag = [3.0, 4.0]
[scintillation]
strength = 0.0
[seeing]
moffat_beta = 100.0
[camera]
response_scatter = 0.0
[passing]
streaks_per_h = 0.0
cosmic_rays_per_mpx_s = 0.0
"#;

/// A whole virtual night that is driven by clicks: shown before it begins, started, paused, told of, stopped. Truth: the log, which has each click in its order; the
/// virtual night's own light, which shares no formula with the reduction: each channel's median before and after the pause within 3 % of it (the fibres' coupling under the
/// telescope's jitter is taken out to 2 %, photons leave less than 1 %), the same as without the page; and no sample of the pause.
#[test]
fn a_virtual_night_is_driven_from_the_page() {
    let Some(mut browser) = Browser::start("a_virtual_night_is_driven_from_the_page") else {
        return;
    };
    let folder = Folder::new("page-driven");
    let plan = crate::common::virtual_night::plan_of(&[
        ("from = \"2020-11-18T18:00:00Z\"\n", ""),
        ("exposure_s = 0.5\ninterval_s = 2.0", "exposure_s = 0.1\ninterval_s = 0.5"),
    ]);
    crate::common::virtual_night::write(&folder.0, &plan, DRIVEN);
    let mut serving = Serving::observe(&folder, &["--wait"]);
    browser.open(&serving.url);
    browser.until("document.getElementById('mode').innerText === 'waiting for Start'");
    // The plan is seen, nothing is recorded, and nothing else is taken.
    browser.until("sunglint.about.visits.some((v) => v.kind === 'star')");
    assert!(!folder.path("session").exists());
    browser.run("document.getElementById('note').value = 'too early'");
    browser.click("#note-form button");
    browser.until("document.getElementById('notice').innerText.includes('has not been started')");
    browser.run("document.getElementById('note').value = ''");
    looks_good(&mut browser, "waiting");
    browser.complaints.retain(|text| !text.contains("409"));
    browser.click("#start");
    browser.until("document.getElementById('mode').innerText === 'live'");
    browser.until("sunglint.live.target?.kind === 'star'");
    browser.until("sunglint.live.now_s - sunglint.live.target.from_s > 8");
    browser.click("#pause");
    browser.until("document.getElementById('mode').innerText === 'paused'");
    browser.until("sunglint.live.target?.kind === 'none' && sunglint.live.now_s - sunglint.live.target.from_s > 3");
    browser.click("#pause");
    browser.until("document.getElementById('mode').innerText === 'live'");
    browser.run("document.getElementById('note').value = 'clear'");
    browser.click("#note-form button");
    browser.until("document.getElementById('events').innerText.includes('note: clear')");
    browser.until("sunglint.live.target?.kind === 'star' && sunglint.live.now_s - sunglint.live.target.from_s > 8");
    assert_eq!(browser.complaints, Vec::<String>::new());
    browser.click("#stop");
    assert!(serving.child.wait().unwrap().success());
    let session = Session::open(folder.path("session")).unwrap();
    let expected = ["start", "pause", "resume", "note", "stop"];
    let found: Vec<String> = controls(&session).into_iter().map(|(action, _)| action).collect();
    assert_eq!(found, expected);
    let at = |word: &str| {
        let events = session.events().unwrap().map(Result::unwrap);
        let mut of =
            events.filter(|e| matches!(&e.what, What::Control { action, .. } if action == word));
        of.next().unwrap().utc
    };
    let pause = (at("pause"), at("resume"));
    let report = session.check().unwrap();
    assert!(report.is_whole(), "{:?}", report.findings);
    let truth: Value =
        serde_json::from_slice(&std::fs::read(folder.path("session/virtual/truth.json")).unwrap())
            .unwrap();
    let visits = truth["visits"].as_array().unwrap();
    let star = visits.iter().find(|visit| visit["kind"] == "star").unwrap();
    folder.done(&["reduce", "session", "-o", "out/"]);
    let mut curves = 0;
    for entry in std::fs::read_dir(folder.path("out")).unwrap() {
        let path = entry.unwrap().path();
        // A curve for each visit, beside the summary and figures.
        let name = path.file_name().unwrap().to_str().unwrap();
        if !name.ends_with("_1.ecsv") && !name.ends_with("_2.ecsv") {
            continue;
        }
        curves += 1;
        let table = sunglint_formats::ecsv::read(&path).unwrap();
        let curve =
            sunglint_radiometry::light_curve::LightCurve::from_table(&path, &table).unwrap();
        for (i, time) in curve.samples.time.iter().enumerate() {
            let half = hifitime::Duration::from_seconds(0.5 * curve.samples.exposure_s[i]);
            let within = *time - half >= pause.0 && *time + half <= pause.1;
            assert!(!within, "{time} is in the pause");
            // A frame that goes on into the pause is there, without a rate.
            let crosses = *time + half > pause.0 && *time - half < pause.0;
            let mut planes = curve
                .channels
                .iter()
                .filter(|channel| ["r", "g", "b"].contains(&channel.name.as_str()));
            assert!(
                !crosses || planes.all(|plane| plane.rate_hz[i].is_nan()),
                "{time} goes on into the pause"
            );
        }
        for channel in &curve.channels {
            let mut rates: Vec<f64> =
                channel.rate_hz.iter().copied().filter(|rate| rate.is_finite()).collect();
            rates.sort_by(f64::total_cmp);
            assert!(rates.len() > 10, "{}: {} rates", channel.name, rates.len());
            let median = rates[rates.len() / 2];
            let expected = star["arriving_hz"][&channel.name].as_f64().unwrap();
            println!("{}: {median:.0} for {expected:.0}", channel.name);
            assert!(
                (median / expected - 1.0).abs() < 0.03,
                "{}: {median} for {expected}",
                channel.name
            );
        }
    }
    assert_eq!(curves, 2);
}

/// The browser is led to the page by a file: the token stands in no command line. Truth: what a program in place of `xdg-open` was called with, the file's mode and text, a browser
/// that opens it; and that it is gone in the end.
#[test]
fn the_token_is_in_no_command_line() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = Folder::new("page-door");
    Recording { frame_px: 16, ..Recording::default() }.write(&folder.path("night"));
    let bin = folder.path("bin");
    let run = folder.path("run");
    for made in [&bin, &run] {
        std::fs::create_dir(made).unwrap();
    }
    let fake = bin.join("xdg-open");
    std::fs::write(&fake, "#!/bin/sh\necho \"$@\" > \"$XDG_RUNTIME_DIR/called.tmp\"; mv \"$XDG_RUNTIME_DIR/called.tmp\" \"$XDG_RUNTIME_DIR/called\"\n").unwrap();
    std::fs::set_permissions(&fake, std::fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let variables = [("PATH", path.as_str()), ("XDG_RUNTIME_DIR", run.to_str().unwrap())];
    let mut serving =
        Serving::with(&folder, &["page", "night", "--address", "127.0.0.1:0"], &variables);
    let begun = Instant::now();
    while !run.join("called").exists() {
        assert!(begun.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(20));
    }
    let called = std::fs::read_to_string(run.join("called")).unwrap();
    let door = PathBuf::from(called.trim());
    let token = serving.url.split("#token=").nth(1).unwrap().to_owned();
    assert!(token.len() == 32 && !called.contains(&token), "{called}");
    assert_eq!(std::fs::metadata(&door).unwrap().permissions().mode() & 0o777, 0o600);
    assert!(std::fs::read_to_string(&door).unwrap().contains(&serving.url));
    if let Some(mut browser) = Browser::start("the_token_is_in_no_command_line") {
        browser.call("Page.navigate", json!({"url": format!("file://{}", door.display())}));
        browser.until("document.documentElement?.dataset.ready === 'yes'");
        assert_eq!(browser.run("sessionStorage.getItem('sunglint-token')"), token);
        assert_eq!(browser.complaints, Vec::<String>::new());
    }
    assert_eq!(serving.interrupt(), Some(0));
    assert!(!door.exists());
}

/// A camera that cannot be opened: an alarm at the top, names in the tables stay in one piece, and the counts go on.
#[test]
fn a_lost_camera_is_an_alarm() {
    let Some(mut browser) = Browser::start("a_lost_camera_is_an_alarm") else { return };
    let folder = Folder::new("page-alarm");
    let plan = LIVE_PLAN.replace("\"sim-camera\"", "\"indi-camera:localhost:1/None\"");
    std::fs::write(folder.path("night.toml"), plan).unwrap();
    let arguments = ["observe", "night.toml", "-o", "session", "--anyway", "--page", "127.0.0.1:0"];
    let mut serving = Serving::start(&folder, &arguments);
    browser.open(&serving.url);
    browser.until("document.getElementById('alarm').innerText.startsWith('cam is lost: ')");
    browser.until("sunglint.counts.tagger?.start_s.length > 5");
    looks_good(&mut browser, "alarm");
    browser.size(400, 800);
    browser.settle();
    let lines = "[...document.querySelectorAll('#devices td:first-child, #devices th, #visits th')].map((e) => { const r = document.createRange(); r.selectNodeContents(e); return [...new Set([...r.getClientRects()].map((b) => b.top))].length; })";
    let lines = browser.run(lines);
    assert!(lines.as_array().unwrap().iter().all(|n| *n == 1), "{lines}");
    assert_eq!(browser.complaints, Vec::<String>::new());
    browser.click("#stop");
    // Data are missing: the program says so.
    assert!(serving.child.wait().unwrap().code().is_some());
    let events = std::fs::read_to_string(folder.path("session/events.jsonl")).unwrap();
    assert!(events.contains("\"action\":\"stop\""));
}

/// The server ends and another begins at the same place: the page comes back by itself, to the new night.
#[test]
fn the_page_survives_a_restart() {
    let Some(mut browser) = Browser::start("the_page_survives_a_restart") else { return };
    let folder = Folder::new("page-restart");
    std::fs::write(folder.path("night.toml"), LIVE_PLAN).unwrap();
    let mut first = Serving::start(
        &folder,
        &["observe", "night.toml", "-o", "one", "--anyway", "--page", "127.0.0.1:0"],
    );
    browser.open(&first.url);
    browser.until("sunglint.counts.tagger?.start_s.length > 5");
    let host = first.host();
    assert_eq!(first.interrupt(), Some(0));
    browser.until(
        "['no connection', 'ended: stopped'].includes(document.getElementById('mode').innerText)",
    );
    // Longer than what is told as an absence.
    std::thread::sleep(Duration::from_secs(4));
    let _second = Serving::start(
        &folder,
        &["observe", "night.toml", "-o", "two", "--anyway", "--page", &host],
    );
    browser.until("document.getElementById('name').innerText === 'two'");
    browser.until("document.getElementById('mode').innerText === 'live' && sunglint.counts.tagger?.start_s.length > 5");
    let said = browser.text("#notice");
    // It has another token: the controls are gone, and it says where they are.
    assert!(said.contains("started again") && said.contains("To steer it"), "{said}");
    assert_eq!(browser.run("document.getElementById('steer').hidden"), true);
}

/// A virtual star far from the frame's middle: 1,000 frames of 0.2 s, a point that lies within the aperture, nothing that crosses.
pub(crate) const LOCKED: &str = r#"
seed = 5
[plan]
stars = 1
visit_s = 200
sky_s = 5
slew_s = 2
dark_s = 5
v_mag = [3.5, 4.5]
[scintillation]
strength = 0.0
[seeing]
fwhm_arcsec = 2.0
moffat_beta = 100.0
scatter = 0.0
[pointing]
jitter_px = 0.5
aim_px = [30.0, 22.0]
aim_scatter_px = 0.0
[camera]
response_scatter = 0.0
cold_fraction = 0.0
dead_fraction = 0.0
[passing]
streaks_per_h = 0.0
cosmic_rays_per_mpx_s = 0.0
"#;

/// Adds a point of 4 px to a frame.
fn add_point(frame: &mut sunglint_formats::Frame, at: [f64; 2], peak_adu: f64) {
    for ((row, column), pixel) in frame.pixels.indexed_iter_mut() {
        let r2 = (column as f64 - at[0]).powi(2) + (row as f64 - at[1]).powi(2);
        let light = peak_adu * (-4.0 * 2_f64.ln() * r2 / 16.0).exp();
        *pixel = (f64::from(*pixel) + light).min(65_535.0) as u16;
    }
}

/// Where a page's image shows a place of its frame, window px.
fn on_screen(browser: &mut Browser, [column, row]: [f64; 2]) -> [f64; 2] {
    let script = format!(
        "(() => {{ const e = document.getElementById('image'); e.scrollIntoView({{block: 'center'}}); const r = e.getBoundingClientRect(); const [w, h] = sunglint.frame.header.size_px;
         const each = Math.max(w / r.width, h / r.height); return [r.left + r.width / 2 + ({column} + 0.5 - w / 2) / each, r.top + r.height / 2 + ({row} + 0.5 - h / 2) / each]; }})()"
    );
    let at = browser.run(&script);
    [0, 1].map(|i| at[i].as_f64().unwrap())
}

fn click_at(browser: &mut Browser, at: [f64; 2]) {
    for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
        let params =
            json!({"type": kind, "x": at[0], "y": at[1], "button": "left", "clickCount": 1});
        browser.call("Input.dispatchMouseEvent", params);
    }
}

fn type_into(browser: &mut Browser, selector: &str, text: &str) {
    let selector = json!(selector);
    browser.run(&format!("(() => {{ const e = document.querySelector({selector}); e.value = {}; e.dispatchEvent(new Event('input', {{bubbles: true}})); }})()", json!(text)));
}

/// Place of the star by its light in the frame that was measured last, px of the frame.
fn star_at(browser: &mut Browser) -> Option<[f64; 2]> {
    let at = browser.run("sunglint.marks?.place_px ?? null");
    Some([at[0].as_f64()?, at[1].as_f64()?])
}

/// Waits until the star stands still in eight frames (it creeps to its place at the end of the way), and gives its place.
fn settled(browser: &mut Browser) -> [f64; 2] {
    let limit = Instant::now() + Duration::from_secs(60);
    let mut seen: Vec<[f64; 2]> = Vec::new();
    loop {
        assert!(Instant::now() < limit, "the star does not stand still: {seen:?}");
        let Some(at) = star_at(browser).filter(|at| seen.last() != Some(at)) else { continue };
        seen.push(at);
        let still = seen.iter().rev().take(8);
        let off = |from: &[f64; 2]| (at[0] - from[0]).hypot(at[1] - from[1]);
        if seen.len() >= 8 && still.map(off).fold(0.0, f64::max) < 3.0 {
            return at;
        }
    }
}

/// Waits until the star stands at a place of the frame within 4 px, in three frames.
fn star_stands(browser: &mut Browser, place: [f64; 2]) {
    let (limit, mut near, mut last) = (Instant::now() + Duration::from_secs(60), 0, None);
    while near < 3 {
        assert!(Instant::now() < limit, "the star stands at {last:?}, expected {place:?}");
        let Some(at) = star_at(browser).filter(|at| Some(*at) != last) else { continue };
        let off = (at[0] - place[0]).hypot(at[1] - place[1]);
        near = if off < 4.0 { near + 1 } else { 0 };
        last = Some(at);
    }
}

/// The mount of a virtual night at the speed of time, steered by clicks. Truth: where the star's light stands in the frames by its centroid, against the pixel that was clicked; 45″ beside are 101.5 px at the station's
/// 0.4435″ a pixel, the other way; tolerance 4 px (2″: seeing of 0.2 s, and the mount's own errors). The log has each click in its order.
#[test]
fn the_mount_is_steered_by_clicks() {
    let Some(mut browser) = Browser::start("the_mount_is_steered_by_clicks") else { return };
    let folder = Folder::new("page-mount");
    let plan = format!(
        r#"station = "station"
virtual = "virtual.toml"
for_s = 600
[[camera]]
name = "cam"
device = "virtual"
exposure_s = 0.05
interval_s = 0.5
window_px = [545, 369, 300, 300]
[mount]
device = "virtual"
camera = "cam"
sun_limit_deg = 20
past_meridian_deg = 5
[[visit]]
star = "{}"
for_s = 200
[[visit]]
off = "dark"
for_s = 300
"#,
        crate::common::star_of_now::night_of_now(&folder.path("station"), 2.5..4.5, -1.0..3.0)
    );
    std::fs::write(folder.path("night.toml"), plan).unwrap();
    let options =
        "[pointing]\njitter_px = 0.0\naim_scatter_px = 0.0\n[passing]\nstreaks_per_h = 0.0\n";
    std::fs::write(folder.path("virtual.toml"), options).unwrap();
    let mut serving = Serving::observe(&folder, &["--anyway"]);
    browser.open(&serving.url);
    browser.until(
        "Object.values(sunglint.live?.devices ?? {}).some((d) => d.mount?.state === 'locked')",
    );
    // A lock comes before the light stands still.
    browser.until("Object.values(sunglint.live.devices).some((d) => d.mount?.state === 'locked' && d.mount.seen_arcsec !== null && d.mount.seen_arcsec < 2) && sunglint.frame.header.size_px[0] === 300");
    let first = settled(&mut browser);
    // This light is the target; nothing changes.
    browser.click("#mount-lock");
    // Without a pointer: the cross begins at the light that was found.
    browser.key("ArrowRight");
    browser.key("ArrowLeft");
    browser.key("Enter");
    browser.until("document.getElementById('notice').innerText.includes('for its target')");
    star_stands(&mut browser, first);
    // It is kept elsewhere.
    let place = [first[0] + 40.0, first[1] - 30.0];
    browser.click("#mount-keep");
    let at = on_screen(&mut browser, place);
    click_at(&mut browser, at);
    browser.until("document.getElementById('notice').innerText.includes('kept there')");
    star_stands(&mut browser, place);
    // Focus over the time, of the frames that were measured.
    browser.until("!document.getElementById('looks-box').hidden && sunglint.looks.fwhm_px.filter((v) => v > 1 && v < 20).length > 5");
    looks_good(&mut browser, "mount");
    // Where it turns over: the plan's own number.
    assert_eq!(browser.run("sunglint.about.flip.past_deg"), 5.0);
    // The telescope looks to the right, so that the light goes to the left.
    browser.run("(() => { const s = document.getElementById('mount-step'); s.append(new Option('45″', '45')); s.value = '45'; })()");
    browser.click("[data-jog='1,0']");
    star_stands(&mut browser, [place[0] - 45.0 / 0.44347, place[1]]);
    browser.click("#mount-halt");
    browser.until("Object.values(sunglint.live.devices).some((d) => d.mount?.state === 'stopped')");
    browser.until("sunglint.live.now_s - sunglint.frame.header.start_s > 3");
    browser.click("#mount-follow");
    browser.until("Object.values(sunglint.live.devices).some((d) => d.mount?.state === 'locked')");
    // No light where nothing is followed: refused in words.
    browser.click("#skip");
    browser.until("sunglint.live.target?.kind === 'dark'");
    browser.until("Object.values(sunglint.live.devices).some((d) => d.mount?.state === 'stopped')");
    browser.click("[data-jog='0,1']");
    browser.until("document.getElementById('notice').innerText.includes('follows no target')");
    browser.complaints.retain(|text| !text.contains("409"));
    browser.click("#mount-park");
    browser.until("Object.values(sunglint.live.devices).some((d) => d.mount?.state === 'parked')");
    assert_eq!(browser.complaints, Vec::<String>::new());
    browser.click("#stop");
    assert!(serving.child.wait().unwrap().success());
    let session = Session::open(folder.path("session")).unwrap();
    let found: Vec<String> = controls(&session).into_iter().map(|(action, _)| action).collect();
    assert_eq!(found, ["lock", "keep", "jog", "halt", "follow", "skip", "park", "stop"]);
}

/// A pass whose automatic choice locks on a star (synthetic: drawn into the frames of a virtual night, nearer to the middle than the target), and in five of whose
/// frames an aeroplane's lamp shines into the aperture (drawn, too). Truth: what arrives of the target by the virtual night, which shares no formula with the
/// reduction; the median of 1,000 frames within 1 % of it, which covers how the light changes with the airmass in 200 s. The aperture of 6 px on points 5.7 px wide leaves out 4.8 %
/// (2^(−(12/5.7)²) of a normal profile): the reduction measures that on the frames, adds it and says so.
#[test]
fn a_pass_that_locked_on_a_star_is_rescued() {
    let Some(mut browser) = Browser::start("a_pass_that_locked_on_a_star_is_rescued") else {
        return;
    };
    let folder = Folder::new("page-rescue");
    let plan = crate::common::virtual_night::plan_of(&[
        ("exposure_s = 0.5\ninterval_s = 2.0", "exposure_s = 0.2\ninterval_s = 0.2"),
        ("bin_s = 0.1", "bin_s = 1.0"),
    ]);
    let (_, truth) = crate::common::virtual_night::observe(&folder.0, &plan, LOCKED);
    let session = Session::open(folder.path("session")).unwrap();
    let visits = session.visits().unwrap();
    let visit = visits.iter().find(|visit| visit.target.on).unwrap();
    let inside = |at: hifitime::Epoch| visit.from <= at && visit.to.is_none_or(|to| at < to);
    let files = session.frames("cam").unwrap().files;
    let own: Vec<_> = files.iter().filter(|file| file.start().is_some_and(inside)).collect();
    assert!(own.len() > 950, "{} frames", own.len());
    // The frame's middle is 99.5, 99.5: the target stands 37 px from it, the star 6 px.
    let target_px = [129.5, 121.5];
    let lit = own[500..505].iter().map(|file| file.sequence).collect::<Vec<_>>();
    for file in &own {
        let mut frame = file.read().unwrap();
        add_point(&mut frame, [95.0, 96.0], 900.0);
        if lit.contains(&file.sequence) {
            add_point(&mut frame, [target_px[0] + 3.0, target_px[1]], 20_000.0);
        }
        let overwrite = sunglint_formats::atomic::Overwrite::Allow;
        frame.write_file(&file.path, overwrite).unwrap();
    }
    let before = std::fs::read(&own[500].path).unwrap();
    let mut serving =
        Serving::start(&folder, &["page", "session", "--no-open", "--address", "127.0.0.1:0"]);
    browser.open(&serving.url);
    browser.click("#rework-begin");
    browser.until("sunglint.rework.old !== null");
    browser.run("(() => { const s = document.getElementById('rework-channel'); s.value = 'g'; s.dispatchEvent(new Event('change')); })()");
    let median = |browser: &mut Browser, which: &str| {
        let script = format!(
            "(() => {{ const r = sunglint.rework.{which}.channels.find((c) => c.name === 'g').rate.filter((v) => v !== null).sort((a, b) => a - b); return r[r.length >> 1]; }})()"
        );
        browser.run(&script).as_f64().unwrap()
    };
    let locked = median(&mut browser, "old");
    // Point at the target on the frame that is shown, and choose a smaller aperture.
    browser.click("#point");
    let at = on_screen(&mut browser, target_px);
    click_at(&mut browser, at);
    browser.until("sunglint.rework.now !== sunglint.rework.old");
    type_into(&mut browser, "[data-key='aperture_px']", "6");
    browser.until("sunglint.rework.now.aperture_px[0] === 6");
    browser.until("document.getElementById('by-hand').innerText.startsWith('followed from frame')");
    // Refuse the frames with the lamp: one by a key, four as a stretch of the curve.
    let seek = |browser: &mut Browser, number: u64| {
        browser.run(&format!("(() => {{ const i = sunglint.film.number.indexOf({number}); const s = document.getElementById('slider'); s.value = String(sunglint.film.start_s[i] + 0.01); s.dispatchEvent(new Event('input')); }})()"));
        browser.until(&format!("sunglint.frame.header.number === {number}"));
    };
    let number = json!(lit[0]).as_u64().unwrap();
    seek(&mut browser, number);
    browser.run("document.activeElement.blur()");
    browser.key("x");
    browser.until("document.getElementById('by-hand').innerText.includes('1 frame refused')");
    let ends = browser.run(&format!("(() => {{ const e = document.getElementById('curve'); e.scrollIntoView({{block: 'center'}}); const b = e.getBoundingClientRect(); const p = e.plot;
        return [{}, {}].map((n, k) => {{ const i = sunglint.film.number.indexOf(n); const t = sunglint.film.start_s[i] + (k ? 0.19 : 0.01); return [b.left + p.l + (t - p.from) / (p.to - p.from) * (p.r - p.l), b.top + b.height / 2]; }}); }})()", lit[1], lit[4]));
    // A stretch that is drawn over the curve, where a frame is a pixel wide or more, else one that is marked by keys.
    let spot = |i: usize| [0, 1].map(|k| ends[i][k].as_f64().unwrap());
    if (spot(1)[0] - spot(0)[0]).abs() >= 4.0 {
        for (kind, at) in [
            ("mouseMoved", spot(0)),
            ("mousePressed", spot(0)),
            ("mouseMoved", spot(1)),
            ("mouseReleased", spot(1)),
        ] {
            let params =
                json!({"type": kind, "x": at[0], "y": at[1], "button": "left", "clickCount": 1});
            browser.call("Input.dispatchMouseEvent", params);
        }
    } else {
        seek(&mut browser, lit[1]);
        browser.run("document.activeElement.blur()");
        browser.key("m");
        seek(&mut browser, lit[4]);
        browser.run("document.activeElement.blur()");
        browser.key("m");
    }
    browser.until("document.getElementById('refuse').innerText.startsWith('Refuse 4 frames from')");
    browser.click("#refuse");
    browser.until("document.getElementById('by-hand').innerText.includes('5 frames refused')");
    browser.until("sunglint.rework.now.channels.find((c) => c.name === 'g').rate.filter((v) => v === null).length >= 5");
    // Five keys in a row are one new curve or two, not five: how long one takes is in `campaign_page`.
    let curves = browser.run(
        "(async () => { const input = document.querySelector(\"[data-key='detect_sigma']\"); performance.clearResourceTimings(); for (const v of ['5', '5.', '5.5', '5.', '5']) { input.value = v; input.dispatchEvent(new Event('input', { bubbles: true })); await new Promise((done) => setTimeout(done, 10)); }
         const before = sunglint.rework.now; while (sunglint.rework.now === before) await new Promise((done) => requestAnimationFrame(done));
         const asked = performance.getEntriesByType('resource').filter((e) => e.name.endsWith('/api/reduction')).length; const then = sunglint.rework.now; input.value = ''; input.dispatchEvent(new Event('input', { bubbles: true }));
         while (sunglint.rework.now === then) await new Promise((done) => requestAnimationFrame(done)); return asked; })()",
    );
    assert!(curves.as_u64() <= Some(2) && curves.as_u64() > Some(0), "{curves}");
    // The light is the target's.
    let rescued = median(&mut browser, "now");
    let number = truth.channels.iter().position(|c| c.name == "g").unwrap();
    let middle = visit.from + hifitime::Duration::from_seconds(100.0);
    let truth_s = truth.seconds(middle);
    let mut watch = sunglint_virtual::observatory::watch::Watch::new(truth.clone());
    let of = watch.moment(truth_s).visit.unwrap();
    let expected = truth.visits[of].arriving_hz(number, truth_s);
    println!("locked on a star: {locked:.0}, rescued: {rescued:.0}, truth: {expected:.0} ADU/s");
    assert!((locked / expected - 1.0).abs() > 0.2, "{locked} beside {expected}");
    assert!((rescued / expected - 1.0).abs() < 0.01, "{rescued} beside {expected}");
    let how = browser.text("#curve-how");
    assert!(how.contains("aperture of 6.0 px set by hand: rates are multiplied by"), "{how}");
    // What is wrong is said, and the curve stays.
    type_into(&mut browser, "[data-key='annulus_px.0']", "2");
    browser.until("document.getElementById('curve-why').innerText.includes('annulus_px')");
    type_into(&mut browser, "[data-key='annulus_px.0']", "");
    browser.until("!document.getElementById('curve-why').innerText.includes('annulus_px')");
    looks_good(&mut browser, "rework");
    // The gate above a counter's curve.
    browser.run("(() => { const s = document.getElementById('rework-channel'); s.value = 'spcm'; s.dispatchEvent(new Event('change')); })()");
    browser.settle();
    browser.shot(&pictures().join("rework_gate.png"));
    browser.run("(() => { const s = document.getElementById('rework-channel'); s.value = 'g'; s.dispatchEvent(new Event('change')); })()");
    type_into(&mut browser, "#recipe-name", "rescued");
    browser.click("#save-form button");
    browser.until("document.getElementById('saved-text').innerText.includes('saved as')");
    let file = "(async () => { const headers = {authorization: 'Bearer ' + sessionStorage.getItem('sunglint-token'), 'content-type': 'application/json'};
        const recipe = await (await fetch('api/recipes/rescued', {headers})).json();
        return await (await fetch('api/reduction.ecsv', {method: 'POST', headers, body: JSON.stringify(recipe)})).text(); })()";
    let on_page = browser.run(file).as_str().unwrap().to_owned();
    folder.done(&["reduce", "session", "--recipe", "rescued", "-o", "out/"]);
    let name = std::fs::read_dir(folder.path("out"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .find(|name| name.ends_with("_1.ecsv"))
        .unwrap();
    let reduced = std::fs::read_to_string(folder.path("out").join(name)).unwrap();
    assert!(on_page == reduced, "{} and {} bytes", on_page.len(), reduced.len());
    // Originals as they were; a name is no path; nothing is saved without the token.
    assert_eq!(std::fs::read(&own[500].path).unwrap(), before);
    let status = |body: &str, token: bool| {
        let more = if token {
            "authorization: 'Bearer ' + sessionStorage.getItem('sunglint-token'), "
        } else {
            ""
        };
        format!(
            "fetch('api/recipes', {{method: 'POST', headers: {{{more}'content-type': 'application/json'}}, body: {}}}).then((a) => a.status)",
            json!(body)
        )
    };
    let body = r#"{"name": "NAME", "recipe": {"target": "x", "visit": 1}}"#;
    assert_eq!(browser.run(&status(body, false)), 401);
    for name in ["../x", "a/b", "", "-x", "é", "rescued"] {
        let refused = browser.run(&status(&body.replace("NAME", name), true));
        assert_eq!(refused, if name == "rescued" { 409 } else { 422 }, "{name}");
    }
    assert_eq!(std::fs::read_dir(folder.path("session/reductions")).unwrap().count(), 1);
    let message = folder.refused(2, &["reduce", "session", "--recipe", "other", "-o", "out2/"]);
    assert!(message.contains("it has rescued"), "{message}");
    assert_eq!(serving.interrupt(), Some(0));
}

/// The chosen pass has its light along its course. Truths: the list's own magnitude is that at its brightest above the air (lower in the air it may be a little brighter a moment later; the course has 61 points, between which a satellite in
/// low orbit changes by less than 0.1 mag there); the way over the sky, by the haversines of the places that are drawn, is speed times time (chords and the rule of trapezoids: 2 %); no light comes from the shadow.
fn predicted_along(browser: &mut Browser, n: usize) {
    browser.until("sunglint.planning.curves !== null && document.querySelectorAll('#pass-unit option').length > 1");
    let pass = browser.run(&format!("sunglint.about.passes[{n}]"));
    let list = |key: &str| pass[key].as_array().unwrap().clone();
    let (lit, dark, v, at) = (list("lit"), list("dark"), list("v_at_mag"), list("at_deg"));
    let seen = |i: &usize| lit[*i] == true && dark[*i] == true;
    let brightest =
        (0..v.len()).filter(seen).filter_map(|i| v[i].as_f64()).fold(f64::INFINITY, f64::min);
    let told = pass["v_mag"].as_f64().unwrap();
    assert!((brightest - told).abs() < 0.1, "{brightest} for {told}");
    assert!((0..v.len()).all(|i| lit[i] == true || v[i].is_null()), "{v:?}");
    let place = |i: usize| [0, 1].map(|k| at[i][k].as_f64().unwrap().to_radians());
    let haversine = |i: usize| {
        let ([a0, h0], [a1, h1]) = (place(i), place(i + 1));
        let x =
            ((h1 - h0) / 2.0).sin().powi(2) + h0.cos() * h1.cos() * ((a1 - a0) / 2.0).sin().powi(2);
        2.0 * x.sqrt().asin().to_degrees()
    };
    let time = |i: usize| pass["at_s"][i].as_f64().unwrap();
    let speed = |i: usize| pass["speed_deg_per_s"][i].as_f64().unwrap();
    let way: f64 = (0..at.len() - 1).map(haversine).sum();
    let by_speed: f64 =
        (0..at.len() - 1).map(|i| 0.5 * (speed(i) + speed(i + 1)) * (time(i + 1) - time(i))).sum();
    assert!((by_speed / way - 1.0).abs() < 0.02, "{by_speed} for {way}");
    // In a channel's unit: the highest point of the chart is near the rate that the table has.
    browser.run("(() => { const s = document.getElementById('pass-unit'); s.value = 'Hz'; s.dispatchEvent(new Event('change')); })()");
    browser.until("/up to .* Hz/.test(document.getElementById('pass-curve').ariaLabel)");
    assert!(browser.text("#pass-legend").contains("spcm"), "{}", browser.text("#pass-legend"));
    assert!(browser.text("#pass-speed").contains("°/s"));
    let most = browser.run(&format!("[Math.max(...sunglint.planning.curves.filter((c) => c.unit === 'Hz').flatMap((c) => c.arriving)), Math.max(...sunglint.about.passes[{n}].rates.filter((r) => r.unit === 'Hz').map((r) => r.arriving))]"));
    let [along, best] = [0, 1].map(|i| most[i].as_f64().unwrap());
    assert!(along > 0.9 * best, "{along} for {best}");
    browser.run("(() => { const s = document.getElementById('pass-unit'); s.value = 'V'; s.dispatchEvent(new Event('change')); })()");
}

/// Three passes and eight stars, clicked on the sky and put into order. Truth: the plan's own text, read by another TOML reader: what was clicked, in that order, each pass from its
/// beginning to its end as `passes` lists it; and `observe --check`, which finds nothing but that the night is past.
#[test]
fn a_night_is_planned_by_clicks() {
    let Some(mut browser) = Browser::start("a_night_is_planned_by_clicks") else { return };
    let folder = Folder::new("page-plan");
    std::fs::write(folder.path("devices.toml"), DEVICES).unwrap();
    let tle = sunglint_testkit::fixture("passes/satellites.tle").display().to_string();
    let command = [
        "passes",
        "--tle",
        &tle,
        "--from",
        "2024-08-12T17:00",
        "--to",
        "2024-08-13T05:00",
        "--norad",
        "90002,90004,90006,90007",
        "--devices",
        "devices.toml",
        "-o",
        "night.toml",
        "--page",
        "127.0.0.1:0",
        "--no-open",
    ];
    let mut serving = Serving::start(&folder, &command);
    browser.open(&serving.url);
    browser.until("sunglint.planning.plan?.visits.length > 3");
    // Three passes, not at the same time, by the sky or, where another lies over it, by the list.
    let passes = browser.run("sunglint.about.passes.map((p) => [p.from_s, p.to_s, p.label])");
    let passes = passes.as_array().unwrap().clone();
    let night_s = browser.run("sunglint.about.length_s").as_f64().unwrap();
    let mut chosen: Vec<usize> = Vec::new();
    let span = |i: usize| [0, 1].map(|k| passes[i][k].as_f64().unwrap());
    for i in 0..passes.len() {
        let free =
            |j: &usize| span(i)[0] > span(*j)[1] + 1200.0 || span(*j)[0] > span(i)[1] + 1200.0;
        // Six stars follow the last one before the sky is bright; none fills half of the night.
        let early = span(i)[1] < night_s - 3600.0 - 1500.0 && span(i)[1] - span(i)[0] < 1500.0;
        if chosen.len() < 3 && early && chosen.iter().all(free) {
            chosen.push(i);
        }
    }
    assert_eq!(chosen.len(), 3, "{passes:?}");
    chosen.sort_by(|a, b| span(*a)[0].total_cmp(&span(*b)[0]));
    let mut by_sky = 0;
    // The last first: the list keeps the order of time.
    for &n in chosen.iter().rev() {
        let at = browser.run(&format!("(() => {{ const e = document.getElementById('sky'); e.scrollIntoView({{block: 'center'}}); const b = e.getBoundingClientRect(); const p = sunglint.about.passes[{n}];
            const at = p.at_deg.reduce((a, c) => (c[1] > a[1] ? c : a)); const [x, y] = sunglint.planning.place(at); return [b.left + x, b.top + y]; }})()"));
        click_at(&mut browser, [0, 1].map(|i| at[i].as_f64().unwrap()));
        match browser.run("sunglint.planning.chosen") == json!(n) {
            true => by_sky += 1,
            false => browser.click(&format!("#passes tbody tr:nth-child({}) button", n + 1)),
        }
        browser.until(&format!("sunglint.planning.chosen === {n}"));
        // A star may stand where the pass is highest: then the click took it.
        browser.run("for (const li of document.querySelectorAll('#picks li')) if (!li.innerText.includes(' to ')) li.querySelector('button:last-child').click();");
        browser.until("sunglint.planning.picks.every((p) => 'pass' in p)");
        assert!(browser.text("#pass-rates").contains("spcm"), "{}", browser.text("#pass-rates"));
        predicted_along(&mut browser, n);
        browser.click("#pass-add");
    }
    assert!(by_sky > 0);
    browser.until("sunglint.planning.picks.filter((p) => 'pass' in p).length === 3");
    // Two stars that stand high when the second pass is over, brought before the third by its own arrow; six when the third is over.
    let mut stars: Vec<String> = Vec::new();
    for (pass, count) in [(chosen[1], 2), (chosen[2], 6)] {
        let after = span(pass)[1] + 300.0;
        browser.run(&format!("(() => {{ const s = document.getElementById('plan-time'); s.value = '{after}'; s.dispatchEvent(new Event('input')); }})()"));
        browser.until(&format!("Math.abs((sunglint.sky?.at_s ?? 0) - {after}) < 11"));
        browser.settle();
        let found = browser.run(&format!("(() => {{ const far = (s, at) => {{ const [a, b] = sunglint.planning.place(s.at_deg); const [x, y] = sunglint.planning.place(at); return Math.hypot(a - x, b - y); }};
            const tracks = sunglint.about.passes.flatMap((p) => p.at_deg).filter((at) => at[1] > 0);
            const good = sunglint.sky.stars.filter((s) => s.v_mag > 1 && s.v_mag < 3.9 && s.at_deg[1] > 42 && s.at_deg[1] < 80 && sunglint.planning.picks.every((p) => p.star !== s.plan_name) && tracks.every((at) => far(s, at) > 13) && sunglint.sky.stars.every((o) => o === s || far(s, o.at_deg) > 4));
            return good.slice(0, {count}).map((s) => s.plan_name); }})()"));
        let found: Vec<String> =
            found.as_array().unwrap().iter().map(|s| s.as_str().unwrap().to_owned()).collect();
        assert_eq!(found.len(), count, "{found:?}");
        for (i, star) in found.into_iter().enumerate() {
            if i == 0 {
                // Without a pointer: by the list.
                let name = json!(format!("add {star}"));
                browser.until(&format!("[...document.querySelectorAll('#stars button')].some((b) => b.ariaLabel === {name})"));
                let add = format!(
                    "[...document.querySelectorAll('#stars button')].find((b) => b.ariaLabel === {name}).click()"
                );
                browser.run(&add);
                stars.push(star);
                continue;
            }
            let at = browser.run(&format!("(() => {{ const e = document.getElementById('sky'); e.scrollIntoView({{block: 'center'}}); const b = e.getBoundingClientRect(); const s = sunglint.sky.stars.find((s) => s.plan_name === {}); const [x, y] = sunglint.planning.place(s.at_deg); return [b.left + x, b.top + y]; }})()", json!(star)));
            click_at(&mut browser, [0, 1].map(|i| at[i].as_f64().unwrap()));
            browser
                .until(&format!("sunglint.planning.picks.some((p) => p.star === {})", json!(star)));
            stars.push(star);
        }
        if count == 2 {
            // The list is drawn again when the plan comes: the element itself is asked, once.
            browser.run(
                "document.querySelector('#picks li:nth-child(3) button:nth-of-type(2)').click()",
            );
            browser.until("'pass' in sunglint.planning.picks[3]");
            // The list is drawn again when the plan comes: the element itself is asked, once.
            browser.run(
                "document.querySelector('#picks li:nth-child(4) button:nth-of-type(2)').click()",
            );
            browser.until("'pass' in sunglint.planning.picks[4]");
            browser.until("'pass' in sunglint.planning.picks[4]");
        }
    }
    browser
        .until("sunglint.planning.plan !== null && !document.getElementById('plan-save').disabled");
    let titles = browser.text("#plan-title-line");
    assert_eq!(titles, "3 passes, 8 stars");
    browser.until("sunglint.planning.plan?.visits.filter((v) => v.bv_mag !== null).length === 8");
    looks_good(&mut browser, "plan");
    browser.click("#plan-save");
    browser.until("sunglint.planning.saved !== null");
    let saved = browser.run("sunglint.planning.saved");
    assert_eq!(saved["errors"], 0, "{}", saved["check"]);
    assert_eq!(browser.complaints, Vec::<String>::new());
    let text = std::fs::read_to_string(folder.path("night.toml")).unwrap();
    assert!(text.contains(DEVICES.trim_end()));
    let table: toml::Table = text.parse().unwrap();
    let visits = table["visit"].as_array().unwrap();
    let of = |key: &str| {
        let named = visits.iter().filter_map(|visit| visit.get(key)?.as_str());
        named.map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(of("star"), stars);
    let order: Vec<&str> = visits
        .iter()
        .filter_map(|visit| ["star", "tle"].into_iter().find(|key| visit.get(*key).is_some()))
        .collect();
    let expected = [&["tle"; 2][..], &["star"; 2], &["tle"], &["star"; 6]].concat();
    assert_eq!(order, expected);
    let listed = folder.json(&[&command[..9], &["--station", "ufo", "--json"]].concat());
    for visit in visits.iter().filter(|visit| visit.get("tle").is_some()) {
        let object: u64 = visit["object"].as_str().unwrap().parse().unwrap();
        let from = visit["from"].as_str().unwrap();
        let found = listed["passes"].as_array().unwrap().iter().any(|pass| {
            let begins = pass["start"]["utc"].as_str().or(pass["start"]["time_utc"].as_str());
            pass["norad_id"] == object
                && begins.is_some_and(|begins| {
                    let [a, b] =
                        [from, begins].map(|t| sunglint_formats::time::parse_utc(t).unwrap());
                    (a - b).to_seconds().abs() < 1.001
                })
        });
        assert!(found, "{object} {from}: {}", listed["passes"][0]["start"]);
    }
    let check = folder.run(&["observe", "night.toml", "--check", "--json"]);
    let check: Value = serde_json::from_slice(&check.stdout).unwrap();
    let errors: Vec<&Value> = check["findings"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|finding| finding["level"] == "error")
        .collect();
    assert!(
        errors.iter().all(|error| ["ago", "elements are"]
            .iter()
            .any(|text| error["text"].to_string().contains(text))),
        "{errors:?}"
    );
    // What cannot be is said: passes in the wrong order, a star that is none, more stars than the time between two passes has.
    for (picks, text) in [
        (json!([{"pass": chosen[1]}, {"pass": chosen[0]}]), "cannot follow each other"),
        (json!([{"star": "Vegas"}]), "Vegas"),
        (json!([{"pass": 99}]), "there is no pass 99"),
        (
            Value::Array(
                [
                    vec![json!({"pass": chosen[0]})],
                    vec![json!({"star": "Vega"}); 400],
                    vec![json!({"pass": chosen[1]})],
                ]
                .concat(),
            ),
            "400 stars need",
        ),
        (json!([{"moon": 1}]), "no plan"),
    ] {
        let ask = format!(
            "fetch('api/plan', {{method: 'POST', headers: {{authorization: 'Bearer ' + sessionStorage.getItem('sunglint-token'), 'content-type': 'application/json'}}, body: {}}}).then((a) => a.text())",
            json!(json!({"picks": picks}).to_string())
        );
        let said = browser.run(&ask);
        assert!(said.as_str().unwrap().contains(text), "{said} for {text}");
    }
    // A plan that somebody edited meanwhile is not replaced; as it was saved it is.
    let save = "fetch('api/save', {method: 'POST', headers: {authorization: 'Bearer ' + sessionStorage.getItem('sunglint-token'), 'content-type': 'application/json'}, body: JSON.stringify({picks: sunglint.planning.picks})}).then(async (a) => `${a.status} ${await a.text()}`)";
    let edited = format!("# by hand\n{text}");
    std::fs::write(folder.path("night.toml"), &edited).unwrap();
    let said = browser.run(save);
    let said = said.as_str().unwrap();
    assert!(said.starts_with("409") && said.contains("night.toml was changed since"), "{said}");
    assert_eq!(std::fs::read_to_string(folder.path("night.toml")).unwrap(), edited);
    std::fs::write(folder.path("night.toml"), &text).unwrap();
    assert!(browser.run(save).as_str().unwrap().starts_with("200"));
    // Elements of that name that are there are told of before anybody plans.
    std::fs::remove_file(folder.path("night.toml")).unwrap();
    let message = folder.refused(1, &command);
    assert!(message.contains("night.tle"), "{message}");
    // Without the token the page shows, and writes nothing.
    let refused = "fetch('api/save', {method: 'POST', headers: {'content-type': 'application/json'}, body: '{\"picks\":[]}'}).then((a) => a.status)";
    assert_eq!(browser.run(refused), 401);
    assert_eq!(serving.interrupt(), Some(0));
}

/// A run in the lab with the drivers' simulated devices, which answer at their own pace: paused and stopped by clicks. Truth: the readings in the run's folder are those of the page.
#[test]
fn a_lab_run_on_the_page() {
    let Some(mut browser) = Browser::start("a_lab_run_on_the_page") else { return };
    let folder = Folder::new("page-lab");
    let run = crate::common::page_toml("lab.md", "[scan]")
        .replace("virtual = \"rig.toml\"", "")
        .replace("tolerance_deg", "device = \"sim-tmcl\"\ntolerance_deg")
        .replace("settle_s", "device = \"sim-pm100\"\nsettle_s")
        .replace("from_deg = -10", "from_deg = 0")
        .replace("settle_s = 1.0", "settle_s = 0.05");
    std::fs::write(folder.path("run.toml"), run).unwrap();
    let command = ["brdf", "retro", "run.toml", "--yes", "-o", "out/", "--page", "127.0.0.1:0"];
    let mut serving = Serving::start(&folder, &command);
    browser.open(&serving.url);
    browser.until("sunglint.lab.places.length > 2");
    browser.click("#pause");
    browser.until("document.getElementById('mode').innerText === 'paused'");
    let count = |browser: &mut Browser| browser.run("sunglint.lab.view.readings").as_u64().unwrap();
    std::thread::sleep(Duration::from_millis(300));
    browser.until("sunglint.lab.view.paused");
    let before = count(&mut browser);
    std::thread::sleep(Duration::from_millis(700));
    assert_eq!(count(&mut browser), before, "a paused run reads");
    looks_good(&mut browser, "lab");
    browser.click("#pause");
    browser.until(&format!("sunglint.lab.view.readings > {before}"));
    browser.until("document.getElementById('target').innerText.includes('left')");
    browser.click("#pause");
    browser.until("document.getElementById('mode').innerText === 'paused'");
    std::thread::sleep(Duration::from_millis(300));
    let places = browser.run("sunglint.lab.places.map((p) => [p.angle_deg, p.mean_w])");
    browser.click("#stop");
    assert_eq!(serving.child.wait().unwrap().code(), Some(1));
    let table = sunglint_formats::ecsv::read(folder.path("out/readings.ecsv")).unwrap();
    let (angles, powers) = (table.f64("angle_deg").unwrap(), table.f64("power_w").unwrap());
    let states = table.text("state").unwrap();
    let (mut found, mut now) = (Vec::new(), Vec::new());
    for ((angle, power), state) in angles.iter().zip(powers.iter()).zip(states.iter()) {
        match state.as_deref().unwrap_or_default() {
            "read" => now.push(*power),
            "kept" => {
                let mean = now.iter().sum::<f64>() / now.len() as f64;
                found.push((*angle, mean));
                now.clear();
            }
            _ => now.clear(),
        }
    }
    let places = places.as_array().unwrap();
    assert!(places.len() > 3 && found.len() >= places.len());
    for (place, (angle, mean)) in places.iter().zip(found) {
        assert_eq!(place[0].as_f64().unwrap(), angle);
        assert!((place[1].as_f64().unwrap() - mean).abs() <= 1e-12 * mean.abs());
    }
    assert_eq!(browser.complaints, Vec::<String>::new());
}
