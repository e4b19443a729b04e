//! Parts of the page that are held against other programs: planets, magnitudes, and the files that it saves.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::common::browser::Browser;
use crate::common::night::{Recording, bins};
use crate::page::{Serving, looks_good};
use serde_json::{Value, json};
use sunglint_formats::session::Session;
use sunglint_numerics::order::{median, robust_sigma};

const ON: [&str; 4] = ["page", "night", "--no-open", "--address"];

/// Planets on the page's sky. Truth: astropy's `get_body` with its built-in ephemeris over the same site at the same time, 0.01° (the page has the Earth's orientation of that day, astropy none);
/// what lies below the horizon is left out.
#[test]
fn the_planets_are_on_the_sky() {
    let test = "the_planets_are_on_the_sky";
    let Some(python) = sunglint_testkit::peer_python(test, &["astropy"]) else { return };
    let folder = Folder::new("page-planets");
    Recording { frame_px: 16, ..Recording::default() }.write(&folder.0.join("night"));
    let serving = Serving::start(&folder, &[&ON[..], &["127.0.0.1:0"]].concat());
    let script = "import json, sys\nfrom astropy import units as u\nfrom astropy.coordinates import AltAz, EarthLocation, get_body, solar_system_ephemeris\nfrom astropy.time import Time\n\
        from astropy.utils import iers\niers.conf.auto_download = False\niers.conf.iers_degraded_accuracy = 'warn'\nsolar_system_ephemeris.set('builtin')\n\
        place = EarthLocation.from_geodetic(9.196417 * u.deg, 48.782389 * u.deg, 399 * u.m)\nout = []\n\
        for seconds in json.loads(sys.argv[1]):\n t = Time('2020-11-18T17:00:00') + seconds * u.s\n frame = AltAz(obstime=t, location=place, pressure=0 * u.hPa)\n\
        \x20out.append([[name, *(lambda p: [p.az.deg, p.alt.deg])(get_body(name.lower(), t, place).transform_to(frame))] for name in ['Mercury', 'Venus', 'Mars', 'Jupiter', 'Saturn']])\nprint(json.dumps(out))";
    let times = [0.0, 3600.0 * 6.0, 3600.0 * 11.5];
    let theirs = sunglint_testkit::run_python(&python, script, &[&json!(times).to_string()]);
    let theirs: Value = serde_json::from_str(&theirs).unwrap();
    let mut seen = 0;
    for (at_s, theirs) in times.iter().zip(theirs.as_array().unwrap()) {
        let sky = serving.json(&format!("/api/sky?at_s={at_s}"));
        let ours = sky["planets"].as_array().unwrap();
        for planet in theirs.as_array().unwrap() {
            let [azimuth, altitude] = [1, 2].map(|i| planet[i].as_f64().unwrap());
            let found = ours.iter().find(|ours| ours["name"] == planet[0]);
            if altitude.abs() < 0.02 {
                continue;
            }
            assert_eq!(found.is_some(), altitude > 0.0, "{planet} at {at_s} s");
            let Some(found) = found else { continue };
            seen += 1;
            let at = [0, 1].map(|i| found["at_deg"][i].as_f64().unwrap());
            let around = (at[0] - azimuth + 180.0).rem_euclid(360.0) - 180.0;
            let off = (around * altitude.to_radians().cos()).hypot(at[1] - altitude);
            assert!(off < 0.01, "{planet}: {off}° from {at:?}");
        }
    }
    assert!(seen >= 5, "{seen}");
    let Some(mut browser) = Browser::start(test) else { return };
    browser.open(&serving.url);
    browser.until("sunglint.sky?.planets.length > 1");
    browser.until("document.getElementById('sky-text').innerText.includes('Jupiter -2')");
}

/// A clip and figures of a recorded session. Truth: the browser's own decoder of animated PNG, and the session's files: each frame's pixels by the stretch that is shown, worked out here; the
/// curve in the SVG has a point for each bin, its height a line in the bin's rate. Names are text there, too.
#[test]
fn clips_and_figures_are_saved() {
    let Some(mut browser) = Browser::start("clips_and_figures_are_saved") else { return };
    let folder = Folder::new("page-clip");
    let session = Recording { seconds: 60.0, frame_px: 120, ..Recording::default() }
        .write(&folder.0.join("night"));
    let log = session.root().join("events.jsonl");
    let name = r#"<img src=x onerror=alert(1)>Vega"#;
    let text = std::fs::read_to_string(&log).unwrap();
    std::fs::write(&log, text.replace("\"Vega\"", &json!(name).to_string())).unwrap();
    let mut serving = Serving::start(&folder, &[&ON[..], &["127.0.0.1:0"]].concat());
    browser.open(&serving.url);
    browser.until("sunglint.frame !== null && sunglint.shown?.bins === 1");
    browser.run("(() => { const s = document.getElementById('stretch'); s.value = 'linear'; s.dispatchEvent(new Event('change')); document.getElementById('clip').open = true; })()");
    browser.until("document.getElementById('clip-to').value === '60'");
    for (id, text) in [("from", "11"), ("to", "40"), ("every", "3"), ("fps", "4")] {
        browser.run(&format!("(() => {{ const e = document.getElementById('clip-{id}'); e.value = '{text}'; e.dispatchEvent(new Event('input')); }})()"));
    }
    let said = browser.text("#clip-text");
    assert!(said.starts_with("10 frames of 120 × 120 px, at most 0.1 MB; plays 3 s"), "{said}");
    let range = browser.run("[sunglint.frame.low, sunglint.frame.high]");
    let [low, high] = [0, 1].map(|i| range[i].as_f64().unwrap());
    browser.click("#clip-form button");
    browser.until("sunglint.saved?.name === 'clip.png'");
    browser.until("document.getElementById('clip-text').innerText.startsWith('10 frames, 0.')");
    let decoded = browser.run(
        "(async () => { const decoder = new ImageDecoder({ data: await sunglint.saved.blob.arrayBuffer(), type: 'image/png' }); await decoder.tracks.ready; await decoder.completed;
         const out = []; const n = decoder.tracks.selectedTrack.frameCount;
         for (let i = 0; i < n; i++) { const { image } = await decoder.decode({ frameIndex: i }); const c = new OffscreenCanvas(image.displayWidth, image.displayHeight).getContext('2d'); c.drawImage(image, 0, 0);
           const d = c.getImageData(0, 0, 120, 120).data; out.push([image.duration, Array.from({ length: 14400 }, (_, k) => d[4 * k])]); }
         return out; })()",
    );
    let decoded = decoded.as_array().unwrap();
    assert_eq!(decoded.len(), 10);
    let files = session.frames("cam").unwrap().files;
    for (i, shown) in decoded.iter().enumerate() {
        // Frames 11, 14, … 38, each a quarter of a second, in µs.
        assert_eq!(shown[0], 250_000);
        let frame = files[10 + 3 * i].read().unwrap();
        for (pixel, found) in frame.pixels.iter().zip(shown[1].as_array().unwrap()) {
            let bright = 255.0 * ((f64::from(*pixel) - low) / (high - low)).clamp(0.0, 1.0);
            let found = found.as_f64().unwrap();
            assert!((found - bright).abs() <= 0.5001, "{found} for {bright}, frame {i}");
        }
    }
    assert_eq!(browser.complaints, Vec::<String>::new());
    // What cannot be is said, with the number.
    let ask = |wish: Value, token: bool| {
        let more = if token {
            "authorization: 'Bearer ' + sessionStorage.getItem('sunglint-token'), "
        } else {
            ""
        };
        format!(
            "fetch('api/clip', {{method: 'POST', headers: {{{more}'content-type': 'application/json'}}, body: {}}}).then(async (a) => `${{a.status}} ${{a.headers.get('content-type') === 'image/png' ? '' : await a.text()}}`)",
            json!(wish.to_string())
        )
    };
    let good =
        json!({"camera": "cam", "from": 1, "to": 5, "range_adu": [500, 516], "shown_ms": 100});
    let with = |key: &str, value: Value| {
        let mut wish = good.clone();
        wish[key] = value;
        wish
    };
    for (wish, token, status, text) in [
        (good.clone(), true, "200", ""),
        (good.clone(), false, "401", ""),
        (with("part_px", json!([100, 110, 500, 500])), true, "200", ""),
        (with("red", json!(true)), true, "200", ""),
        (with("camera", json!("../cam")), true, "404", ""),
        (with("from", json!(70)), true, "422", "no frame from number 70 to 5"),
        (with("range_adu", json!([5, 5])), true, "422", "range_adu"),
        (with("soft", json!(0)), true, "422", "soft"),
        (with("every", json!(0)), true, "422", "every"),
        (with("shown_ms", json!(1)), true, "422", "10 to 10000 ms"),
        (with("colour", json!(1)), true, "400", "colour"),
    ] {
        let said = browser.run(&ask(wish.clone(), token));
        let said = said.as_str().unwrap();
        assert!(said.starts_with(status) && said.contains(text), "{said} for {wish}");
    }
    browser.complaints.clear();
    // The counts as SVG: the curve of the first channel, in its pixels, against the session's bins.
    browser.click("[data-figure='counts svg']");
    browser.until("sunglint.saved.name === 'counts.svg'");
    let svg = browser.run("sunglint.saved.blob.text()");
    let svg = svg.as_str().unwrap();
    let escaped = name.replace('<', "&lt;").replace('>', "&gt;");
    assert!(svg.starts_with("<svg ") && !svg.contains("<img") && svg.contains(&escaped), "{svg}");
    assert!(svg.contains(">g</text>") && svg.contains("night, 2020-11-18 UTC, tagger, as counted"));
    // Within the frame of the plot the first curve is the first channel's.
    let (_, plot) = svg.split_once("<g clip-path=").unwrap();
    let (_, path) = plot.split_once(" d=\"").unwrap();
    let (path, _) = path.split_once('"').unwrap();
    let curve: Vec<[f64; 2]> = path
        .split(['M', 'L'])
        .skip(1)
        .map(|at| {
            let (x, y) = at.split_once(' ').unwrap();
            [x, y].map(|number| number.parse().unwrap())
        })
        .collect();
    let from = "sunglint.shown.start_s.filter((t, i) => t + sunglint.shown.length_s[i] >= document.getElementById('counts').plot.from)[0]";
    let from = browser.run(from).as_f64().unwrap();
    let all = bins(&session);
    let first = (from * 10.0).round() as usize;
    assert!(curve.len() > 300, "{}", curve.len());
    let rate = |i: usize| 10.0 * all[first + i].counts[0] as f64;
    let last = curve.len() - 1;
    for (i, [x, y]) in curve.iter().enumerate() {
        let part = i as f64 / last as f64;
        let line_x = curve[0][0] + part * (curve[last][0] - curve[0][0]);
        let part = (rate(i) - rate(0)) / (rate(last) - rate(0));
        let line_y = curve[0][1] + part * (curve[last][1] - curve[0][1]);
        assert!((x - line_x).abs() < 0.05 && (y - line_y).abs() < 0.05, "{i}: {x}, {y}");
    }
    for (button, name) in
        [("image png", "image.png"), ("sky svg", "sky.svg"), ("sky png", "sky.png")]
    {
        browser.click(&format!("[data-figure='{button}']"));
        browser
            .until(&format!("sunglint.saved.name === '{name}' && sunglint.saved.blob.size > 1000"));
    }
    assert_eq!(browser.complaints, Vec::<String>::new());
    assert_eq!(serving.interrupt(), Some(0));
}

/// Five stars one after the other, two of them like the Sun, with the sky beside each. No scintillation, and the light within the fibres.
const STARS: &str = r#"
seed = 3
[stars]
scatter = 0.0
dimmed = 0
[scintillation]
strength = 0.0
[seeing]
fwhm_arcsec = 2.0
moffat_beta = 100.0
scatter = 0.0
[pointing]
jitter_px = 0.2
aim_scatter_px = 0.0
[passing]
streaks_per_h = 0.0
cosmic_rays_per_mpx_s = 0.0
"#;

/// Magnitudes of counts by the night's own κ. Truth: the catalogue's V of two stars like the Sun (XHIP: Achird 3.46, G3V; iota Persei 4.05, F9.5V), whose light the virtual night makes without a formula of the reduction; κ comes from
/// all five stars by `calibrate`. Tolerance 0.04 mag in the
/// channel whose band is nearest to V: κ (1 %), the colour against the Sun's (0.06 mag of B−V), light that misses the fibres (1 %); 0.08 mag in the other two, in which an F9.5V star differs more from the Sun. The scatter is that of
/// counting: within a quarter of σ.
#[test]
fn magnitudes_as_soon_as_kappa_is_there() {
    let Some(mut browser) = Browser::start("magnitudes_as_soon_as_kappa_is_there") else { return };
    let folder = Folder::new("page-magnitudes");
    let plan = crate::common::virtual_night::plan_of(&[("interval_s = 2.0", "interval_s = 5.0")]);
    let mut options = String::from(STARS);
    let stars = ["Achird", "iot Per", "Mirfak", "Caph", "Alderamin"];
    let mut at_s = 0.0;
    let mut visit = |kind: &str, name: &str, for_s: f64| {
        let from_s = at_s;
        at_s += for_s;
        options += &format!(
            "[[visit]]\nkind = \"{kind}\"\nname = \"{name}\"\nfrom_s = {from_s}\nto_s = {at_s}\n"
        );
    };
    visit("dark", "", 5.0);
    for star in stars {
        visit("sky", "", 10.0);
        visit("star", star, 30.0);
    }
    visit("sky", "", 10.0);
    crate::common::virtual_night::observe(&folder.0, &plan, &options);
    folder.done(&["reduce", "session", "-o", "out/"]);
    folder.done(&["calibrate", "out/", "--station", "ufo", "-o", "kappa.ecsv"]);
    let arguments =
        ["page", "session", "--no-open", "--address", "127.0.0.1:0", "--calibration", "kappa.ecsv"];
    let mut serving = Serving::start(&folder, &arguments);
    let about = serving.json("/api/about");
    let said = about["magnitudes"]["said"].as_str().unwrap();
    assert!(said.starts_with("V above the air") && said.contains("κ of 2020-11-18 (kappa.ecsv)"));
    assert_eq!(about["magnitudes"]["warnings"], json!([]));
    let session = Session::open(folder.path("session")).unwrap();
    let start = session.manifest().start_utc;
    let number = |value: &Value| value.as_f64();
    for (star, v_mag) in [("Achird", 3.46), ("iot Per", 4.05)] {
        let visits = session.visits().unwrap();
        let named = |name: &str| name.contains(star.trim_start_matches("iot "));
        let visit = visits.iter().find(|visit| named(&visit.target.name)).unwrap();
        let from_s = (visit.from - start).to_seconds() + 0.2;
        let counts = serving.json(&format!(
            "/api/counts/tagger?from_s={from_s}&to_s={}&points=2000",
            from_s + 29.0
        ));
        assert_eq!(counts["bins"], 1);
        for (k, channel) in counts["channels"].as_array().unwrap().iter().enumerate() {
            let column = |key: &str| {
                let values = counts["magnitudes"][key][k].as_array().unwrap();
                values.iter().filter_map(number).collect::<Vec<f64>>()
            };
            let (magnitudes, sigmas) = (column("magnitude"), column("sigma_mag"));
            let found = median(magnitudes.iter().copied()).unwrap();
            let sigma = median(sigmas).unwrap();
            let scatter = robust_sigma(magnitudes.iter().map(|m| m - found)).unwrap();
            println!(
                "{star} {channel}: {found:.3} for {v_mag}, scatter {scatter:.4}, σ {sigma:.4}, {} points",
                magnitudes.len()
            );
            assert!(magnitudes.len() > 250, "{star} {channel}: {}", magnitudes.len());
            let limit = if channel == "spcm" { 0.04 } else { 0.08 };
            assert!((found - v_mag).abs() < limit, "{star} {channel}: {found} for {v_mag}");
            assert!((scatter / sigma - 1.0).abs() < 0.25, "{channel}: {scatter} for {sigma}");
        }
        // Beside the target there is none.
        let sky = serving.json(&format!(
            "/api/counts/tagger?from_s={}&to_s={}",
            from_s - 9.0,
            from_s - 1.0
        ));
        assert!(
            sky["magnitudes"]["magnitude"]
                .as_array()
                .unwrap()
                .iter()
                .flat_map(|c| c.as_array().unwrap())
                .all(Value::is_null)
        );
    }
    browser.open(&serving.url);
    browser.until("sunglint.shown?.bins === 1");
    browser.run("(() => { const s = document.getElementById('unit'); s.value = 'mag'; s.dispatchEvent(new Event('change')); })()");
    browser.until("document.getElementById('counts-text').innerText.includes(' mag')");
    let how = browser.text("#counts-how");
    assert!(how.contains("κ of 2020-11-18") && how.contains("counting alone"), "{how}");
    // The reduced curve of the same visit, too, where light that misses the fibres is added.
    browser.click("#rework-begin");
    browser.until("sunglint.rework.old !== null");
    browser.run("for (const [id, value] of [['rework-channel', 'spcm'], ['rework-unit', 'mag']]) { const s = document.getElementById(id); s.value = value; s.dispatchEvent(new Event('change')); }");
    let magnitudes =
        browser.run("sunglint.rework.now.channels.find((c) => c.name === 'spcm').magnitude");
    let found = median(magnitudes.as_array().unwrap().iter().filter_map(number)).unwrap();
    assert!((found - 3.46).abs() < 0.05, "{found}");
    assert!(browser.text("#curve-text").contains("mag, V above the air"));
    looks_good(&mut browser, "magnitudes");
    assert_eq!(browser.complaints, Vec::<String>::new());
    assert_eq!(serving.interrupt(), Some(0));
    // What is no calibration is refused.
    let message =
        folder.refused(1, &["page", "session", "--no-open", "--calibration", "night.toml"]);
    assert!(message.contains("night.toml"), "{message}");
}

/// The virtual night's own coefficients (the station's typical ones), as another night's calibration (synthetic).
const KAPPA: &str = r#"# %ECSV 1.0
# ---
# delimiter: ','
# datatype:
# - {name: night, datatype: string}
# - {name: channel, datatype: string}
# - {name: kappa, datatype: float64}
# - {name: relative_sigma, datatype: float64}
# - {name: kappa_low, datatype: float64}
# - {name: kappa_high, datatype: float64}
# - {name: stars, datatype: int64}
# - {name: visits, datatype: int64}
# - {name: rms, datatype: float64}
# - {name: per_airmass, datatype: float64}
# - {name: per_airmass_sigma, datatype: float64}
# - {name: per_colour, datatype: float64}
# - {name: per_colour_sigma, datatype: float64}
# meta:
#   calibration_version: 1
#   station: ufo
#   nights:
#   - night: '2020-11-18'
#     covariance_ln_kappa: {channels: [id400, spcm, mppc], values: [[0.0001, 0.0, 0.0], [0.0, 0.0001, 0.0], [0.0, 0.0, 0.0001]]}
# schema: astropy-2.0
night,channel,kappa,relative_sigma,kappa_low,kappa_high,stars,visits,rms,per_airmass,per_airmass_sigma,per_colour,per_colour_sigma
2020-11-18,id400,546.51,0.01,535,558,5,5,0.01,nan,nan,nan,nan
2020-11-18,spcm,29.64,0.01,29,30.3,5,5,0.01,nan,nan,nan,nan
2020-11-18,mppc,9.63,0.01,9.4,9.8,5,5,0.01,nan,nan,nan,nan
"#;

/// Magnitudes of a night that runs, by another night's κ. Truth: the V in the catalogue of a star about as yellow as the Sun (B−V within 0.2 mag of its 0.65), to what its colour does in this
/// channel, where light is taken for sunlight (0.3 mag); and the recorded night, whose sky
/// comes from its own files: the same magnitudes within a tenth of σ.
#[test]
fn magnitudes_while_the_night_runs() {
    let Some(mut browser) = Browser::start("magnitudes_while_the_night_runs") else { return };
    let folder = Folder::new("page-live-magnitudes");
    let star =
        crate::common::star_of_now::night_of_now(&folder.path("station"), 2.5..5.0, 0.45..0.85);
    let plan = crate::common::virtual_night::plan_of(&[
        ("station = \"ufo\"\nfrom = \"2020-11-18T18:00:00Z\"", "station = \"station\""),
        ("exposure_s = 0.5", "exposure_s = 0.1"),
    ]);
    let mut options = String::from(STARS);
    for (kind, name, from_s, to_s) in [("sky", "", 0, 5), ("star", &*star, 5, 60)] {
        options += &format!(
            "[[visit]]\nkind = \"{kind}\"\nname = \"{name}\"\nfrom_s = {from_s}\nto_s = {to_s}\n"
        );
    }
    crate::common::virtual_night::write(&folder.0, &plan, &options);
    std::fs::write(folder.path("kappa.ecsv"), KAPPA).unwrap();
    let mut serving = Serving::observe(&folder, &["--calibration", "kappa.ecsv"]);
    browser.open(&serving.url);
    browser.run("(() => { const s = document.getElementById('unit'); s.value = 'mag'; s.dispatchEvent(new Event('change')); })()");
    browser.until("/spcm \\d+\\.\\d+ ± \\d\\.\\d+ mag/.test(document.getElementById('counts-text').innerText)");
    let how = browser.text("#counts-how");
    assert!(how.contains("κ of 2020-11-18 (kappa.ecsv)"), "{how}");
    assert!(how.contains("kappa changes from night to night"), "{how}");
    let points = "(() => { const c = sunglint.counts.tagger; const k = c.channels.indexOf('spcm'); return c.start_s.map((t, i) => [t, c.magnitudes.magnitude[k][i], c.magnitudes.sigma_mag[k][i]]).filter(([, m]) => m !== null); })()";
    browser.until(&format!("{points}.length > 60"));
    let live = browser.run(points);
    assert_eq!(browser.complaints, Vec::<String>::new());
    browser.click("#stop");
    assert!(serving.child.wait().unwrap().success());
    let catalogue = sunglint_radiometry::sky::Catalogue::embedded();
    let v_mag = catalogue.find(&star).unwrap().v_mag.unwrap();
    let arguments = ["page", "session", "--no-open", "--address", "127.0.0.1:0"];
    let recorded =
        Serving::start(&folder, &[&arguments[..], &["--calibration", "kappa.ecsv"]].concat());
    let all = recorded.json("/api/counts/tagger?points=4000");
    assert_eq!(all["bins"], 1);
    let channels = all["channels"].as_array().unwrap();
    let k = channels.iter().position(|channel| channel == "spcm").unwrap();
    let starts = all["start_s"].as_array().unwrap();
    let mut most: f64 = 0.0;
    for point in live.as_array().unwrap() {
        let [at_s, magnitude, sigma] = [0, 1, 2].map(|i| point[i].as_f64().unwrap());
        let of = starts.iter().position(|s| (s.as_f64().unwrap() - at_s).abs() < 0.01).unwrap();
        let again = all["magnitudes"]["magnitude"][k][of].as_f64().unwrap();
        most = most.max((again - magnitude).abs() / sigma);
        assert!((again - magnitude).abs() < 0.1 * sigma, "{again} for {magnitude} ± {sigma}");
        assert!((magnitude - v_mag).abs() < 0.3, "{magnitude} for {v_mag}");
    }
    println!("{star}: V {v_mag}, live and recorded differ by {most:.4} σ at most");
}
