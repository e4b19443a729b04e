//! How fast the page is. The times are figures of the campaign, measured on a computer that does nothing else; the suite judges counts alone.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::common::browser::Browser;
use crate::page::{LIVE_PLAN, LOCKED, Serving, clients, ten_hours};
use serde_json::Value;
use std::time::{Duration, Instant};
use sunglint_formats::session::Session;
use sunglint_testkit::Campaign;

/// Seconds of a night that are watched for each seed.
const WATCHED_S: u64 = 5;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// Part of a core that the page's threads take while somebody watches, and how old bins and frames were on the first browser's screen: medians and largest, s.
fn watched(serving: &Serving, browser: &mut Browser) -> (f64, [Vec<f64>; 2]) {
    let before = (serving.page_cpu_s(), Instant::now());
    browser.run("sunglint.lag = {}");
    std::thread::sleep(Duration::from_secs(WATCHED_S));
    let lags = ["counts", "image"].map(|what| {
        let script = format!("[...sunglint.lag.{what}].sort((a, b) => a - b)");
        numbers(&browser.run(&script))
    });
    let part = (serving.page_cpu_s() - before.0) / before.1.elapsed().as_secs_f64();
    (part, lags)
}

/// A night with ten frames and ten bins a second, three pages and 1,000 clients that are silent or slow; a session of ten hours; a visit of 1,000 frames. Truth: the session's own check for bins that
/// are lost; times by the browser's clock, which is the night's.
#[test]
fn campaign_page() {
    if !sunglint_testkit::alone("campaign_page") {
        return;
    }
    let Some(mut browser) = Browser::start("campaign_page") else { return };
    let mut campaign = Campaign::start("page", 10);
    let (is_whole, seeds) = (campaign.is_whole(), campaign.seeds());
    let folder = Folder::new("page-campaign");
    let plan = LIVE_PLAN
        .replace("exposure_s = 0.1\ninterval_s = 0.3", "exposure_s = 0.05\ninterval_s = 0.1");
    assert!(plan != LIVE_PLAN);
    std::fs::write(folder.path("night.toml"), plan).unwrap();
    let arguments = ["observe", "night.toml", "-o", "session", "--anyway", "--page", "127.0.0.1:0"];
    let mut serving = Serving::start(&folder, &arguments);
    let mut others = Vec::new();
    browser.open(&serving.url);
    for _ in 0..2 {
        let mut other = Browser::start("campaign_page").unwrap();
        other.open(&serving.url);
        others.push(other);
    }
    browser.until("sunglint.counts.tagger?.start_s.length > 20 && sunglint.frame !== null");
    let (mut alone, mut crowded) = (Vec::new(), Vec::new());
    let (mut medians, mut longest) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    let mut take = |lags: [Vec<f64>; 2]| {
        for (i, lags) in lags.into_iter().enumerate() {
            // Each is drawn as it comes, not in bunches.
            assert!(lags.len() > 3, "{lags:?}");
            medians[i].push(lags[lags.len() / 2]);
            longest[i].push(largest(&lags));
        }
    };
    for _ in seeds.clone() {
        let (part, lags) = watched(&serving, &mut browser);
        alone.push(part);
        take(lags);
    }
    let held = clients(&serving);
    // They come all at once, with 5,000 requests: what that costs is a figure of its own.
    let come_s = watched(&serving, &mut browser).0 * WATCHED_S as f64;
    for _ in seeds {
        let (part, lags) = watched(&serving, &mut browser);
        crowded.push(part);
        take(lags);
    }
    drop(held);
    eprintln!("parts of a core, three pages: {alone:.3?}; with 1,000 clients: {crowded:.3?}");
    browser.click("#stop");
    assert!(serving.child.wait().unwrap().success());
    let report = Session::open(folder.path("session")).unwrap().check().unwrap();
    assert!(report.is_whole(), "{:?}", report.findings);
    let gaps = report.counters[0].unflagged_gaps + report.counters[0].flagged_gaps;
    campaign.largest("lost_stretches_of_bins", gaps as f64);
    if is_whole {
        for (name, values) in [
            ("part_of_a_core_three_pages", &alone),
            ("part_of_a_core_three_pages_1000_clients", &crowded),
            ("bin_to_screen_median_s", &medians[0]),
            ("bin_to_screen_longest_s", &longest[0]),
            ("frame_to_screen_median_s", &medians[1]),
            ("frame_to_screen_longest_s", &longest[1]),
        ] {
            campaign.largest(name, largest(values));
        }
        campaign.largest("cpu_s_while_1000_clients_come", come_s);
        drop(others);
        recorded(&mut campaign, &mut browser);
        redrawn(&mut campaign, &mut browser);
    }
    campaign.finish();
}

/// Times of a session of ten hours.
fn recorded(campaign: &mut Campaign, browser: &mut Browser) {
    let folder = Folder::new("page-campaign-long");
    ten_hours(&folder);
    let begun = Instant::now();
    let serving =
        Serving::start(&folder, &["page", "night", "--no-open", "--address", "127.0.0.1:0"]);
    let about = serving.json("/api/about");
    let program_s = begun.elapsed().as_secs_f64();
    assert_eq!(about["length_s"], 36_000.0);
    browser.open(&serving.url);
    browser.until("sunglint.frame !== null");
    // From the beginning of the page to the moment at which it says that it is ready, by its own clock: a second time, with the browser warm.
    browser.call("Page.navigate", serde_json::json!({"url": "about:blank"}));
    browser.call("Page.addScriptToEvaluateOnNewDocument", serde_json::json!({"source": "new MutationObserver(() => { if (document.documentElement?.dataset.ready) window.readyAt ??= performance.now(); }).observe(document, {subtree: true, attributes: true, childList: true})"}));
    browser.open(&serving.url);
    let page_s = browser.run("window.readyAt / 1000").as_f64().unwrap();
    browser.run("(() => { const s = document.getElementById('span'); s.value = '60'; s.dispatchEvent(new Event('change')); })()");
    browser.until("sunglint.shown?.span < 61");
    let mut slowest: f64 = 0.0;
    for k in 1..=20_u32 {
        let t = f64::from(k * 7919 % 36_000) + 0.25;
        let script = format!(
            "(async () => {{ const s = document.getElementById('slider'); const begun = performance.now(); s.value = '{t}'; s.dispatchEvent(new Event('input'));
             while (sunglint.frame?.of !== {} || !(sunglint.shown?.from <= {t} && {t} <= sunglint.shown?.to)) await new Promise((done) => setTimeout(done, 2));
             await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))); return (performance.now() - begun) / 1000; }})()",
            (t / 2.0) as u32
        );
        slowest = slowest.max(browser.run(&script).as_f64().unwrap());
    }
    campaign.largest("ten_hours_open_program_s", program_s);
    campaign.largest("ten_hours_open_page_s", page_s);
    campaign.largest("ten_hours_seek_s", slowest);
}

/// Times from a key to the new curve, for five values of a choice, s; the shortest first.
fn redraws(browser: &mut Browser, key: &str, values: [f64; 5]) -> [f64; 5] {
    let mut took = values.map(|value| {
        let script = format!(
            "(async () => {{ const before = sunglint.rework.now; const input = document.querySelector(\"[data-key='{key}']\"); const begun = performance.now(); input.value = '{value}'; input.dispatchEvent(new Event('input', {{ bubbles: true }}));
             while (sunglint.rework.now === before) await new Promise((done) => setTimeout(done, 2)); await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))); return (performance.now() - begun) / 1000; }})()"
        );
        browser.run(&script).as_f64().unwrap()
    });
    took.sort_by(f64::total_cmp);
    took
}

/// Times of the redraw of 1,000 frames, with the usual target and with one that somebody pointed at.
fn redrawn(campaign: &mut Campaign, browser: &mut Browser) {
    let folder = Folder::new("page-campaign-redraw");
    let plan = crate::common::virtual_night::plan_of(&[
        ("exposure_s = 0.5\ninterval_s = 2.0", "exposure_s = 0.2\ninterval_s = 0.2"),
        ("bin_s = 0.1", "bin_s = 1.0"),
    ]);
    crate::common::virtual_night::observe(&folder.0, &plan, LOCKED);
    let serving =
        Serving::start(&folder, &["page", "session", "--no-open", "--address", "127.0.0.1:0"]);
    browser.open(&serving.url);
    browser.click("#rework-begin");
    browser.until("sunglint.rework.old !== null");
    let frames = browser.run("sunglint.rework.now.frames[0]").as_u64().unwrap();
    assert!(frames > 950, "{frames}");
    let took = redraws(browser, "detect_sigma", [5.0, 7.0, 8.0, 9.0, 5.0]);
    campaign.largest("redraw_1000_frames_median_s", took[2]);
    campaign.largest("redraw_1000_frames_s", took[4]);
    // A target that somebody pointed at is followed from frame to frame. It stands 30 px beside and 22 px below the frame's middle.
    browser
        .run("sunglint.rework.places = [{ camera: 'cam', frame: 400, place_px: [129.5, 121.5] }]");
    let took = redraws(browser, "aperture_px", [6.0, 6.5, 7.0, 7.5, 8.0]);
    let by_hand = browser.text("#by-hand");
    assert!(by_hand.contains("followed from frame 400"), "{by_hand}");
    campaign.largest("redraw_by_hand_1000_frames_median_s", took[2]);
    campaign.largest("redraw_by_hand_1000_frames_s", took[4]);
}
