//! The page when something goes wrong, and without a pointer: tokens that change, alarms, a program that dies, several cameras, long logs, keys.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::common::browser::Browser;
use crate::common::night::Recording;
use crate::page::{LIVE_PLAN, Serving, looks_good};
use serde_json::json;
use std::time::Duration;

/// Changes what the page gets: `change` is the body of a function of an answer to `path`.
fn changed(browser: &mut Browser, path: &str, change: &str) {
    browser.run(&format!(
        "(() => {{ const before = window.fetched ??= window.fetch; window.answers = 0; window.fetch = async (where, ...more) => {{ const answer = await before(where, ...more); if (!String(where).includes({}) || !answer.ok) return answer;
         const view = await answer.json(); window.answers++; (() => {{ {change} }})(); return new Response(JSON.stringify(view)); }}; }})()",
        json!(path)
    ));
}

fn night(folder: &Folder, address: &str) -> Serving {
    std::fs::write(folder.path("night.toml"), LIVE_PLAN).unwrap();
    Serving::start(
        folder,
        &["observe", "night.toml", "-o", "session", "--anyway", "--page", address],
    )
}

/// A page that is open in a browser is given the token, loses it and is given it again, each without being loaded. Truth: the rules of the guide: without the token beyond this computer
/// nothing is told, and then nothing is asked; a token of another start is dropped, and the controls with it.
#[test]
fn a_page_learns_of_its_token() {
    let Some(mut browser) = Browser::start("a_page_learns_of_its_token") else { return };
    let folder = Folder::new("page-token");
    let serving = night(&folder, "0.0.0.0:0");
    let said = &serving.said;
    assert!(
        said.contains("open to other computers") && said.contains("without encryption"),
        "{said}"
    );
    let port = serving.url.split("0.0.0.0:").nth(1).unwrap().split('/').next().unwrap();
    let token = serving.url.split("#token=").nth(1).unwrap().to_owned();
    let bare = format!("http://127.0.0.1:{port}/");
    browser.call("Page.navigate", json!({"url": bare}));
    browser.until("document.getElementById('mode')?.innerText === 'no token'");
    let asked =
        "performance.getEntriesByType('resource').filter((e) => e.name.includes('/api/')).length";
    let before = browser.run(asked);
    std::thread::sleep(Duration::from_millis(2500));
    assert_eq!(browser.run(asked), before, "it asks on without a token");
    // Pasted behind the address of the open page.
    let paste = format!("location.hash = '#token={token}'");
    browser.run(&paste);
    browser.until("document.getElementById('mode').innerText === 'live'");
    assert_eq!(
        browser.run("[location.hash, document.getElementById('steer').hidden]"),
        json!(["", false])
    );
    // The token of another start.
    browser.run("location.hash = '#token=00000000000000000000000000000000'");
    browser.until("document.getElementById('steer').hidden && document.getElementById('mode').innerText === 'no token'");
    browser.until("sessionStorage.getItem('sunglint-token') === null");
    assert_eq!(
        browser.run("[location.hash, document.getElementById('note-form').hidden]"),
        json!(["", true])
    );
    // What was on its way comes to its end.
    std::thread::sleep(Duration::from_millis(1500));
    let before = browser.run(asked);
    std::thread::sleep(Duration::from_millis(1500));
    assert_eq!(browser.run(asked), before);
    browser.run(&paste);
    browser.until("document.getElementById('mode').innerText === 'live' && !document.getElementById('steer').hidden");
    browser.until("document.getElementById('notice').innerText === '' || document.getElementById('notice').innerText.startsWith('back')");
    browser.click("#skip");
    browser.until("document.getElementById('target').innerText.startsWith('Polaris')");
}

/// On this computer a page without the right token goes on and shows.
#[test]
fn a_stale_token_hides_the_controls_alone() {
    let Some(mut browser) = Browser::start("a_stale_token_hides_the_controls_alone") else {
        return;
    };
    let folder = Folder::new("page-stale");
    let serving = night(&folder, "127.0.0.1:0");
    browser.open(&serving.url);
    browser.until("document.getElementById('mode').innerText === 'live' && !document.getElementById('steer').hidden");
    browser.run("location.hash = '#token=00000000000000000000000000000000'");
    browser.until("document.getElementById('steer').hidden");
    browser.until(
        "document.getElementById('notice').innerText.includes(\"the token is not this server's\")",
    );
    let now = browser.run("sunglint.live.now_s").as_f64().unwrap();
    browser.until(&format!(
        "sunglint.live.now_s > {now} + 1 && document.getElementById('mode').innerText === 'live'"
    ));
    assert!(browser.text("#notice").contains("the token is not this server's"));
}

/// Truth: by hand: two alarms whose texts change with every answer (synthetic) are told and sound once each, by one audio device; a program that is killed is an alarm. A fault of the page is
/// told as one, and the page goes on.
#[test]
fn alarms_sound_once() {
    let Some(mut browser) = Browser::start("alarms_sound_once") else { return };
    let folder = Folder::new("page-alarms");
    let mut serving = night(&folder, "127.0.0.1:0");
    browser.open(&serving.url);
    browser.until("sunglint.frame !== null");
    browser.click("#sound");
    // The choice holds.
    browser.open(&serving.url);
    browser.until("document.getElementById('sound').checked");
    browser.run("(() => { window.devices = 0; const own = window.AudioContext; window.AudioContext = class extends own { constructor() { super(); window.devices++; } }; })()");
    let storm = "view.not_written = window.answers; view.devices.cam.state = 'lost'; view.devices.cam.error = `no cable since ${window.answers} s`;";
    changed(&mut browser, "api/live", storm);
    browser.until("sunglint.alarms.told.length >= 2");
    let told = browser.text("#alarm-said");
    browser.until("window.answers > 15");
    assert_eq!(browser.run("sunglint.alarms.told"), json!(["lost cam", "not written"]));
    assert_eq!(browser.run("[sunglint.alarms.beeps, window.devices]"), json!([1, 1]));
    assert_eq!(browser.text("#alarm-said"), told);
    assert!(browser.text("#alarm").contains("rows or frames are not written"));
    // One that comes and goes is the same one; another device is another one.
    changed(
        &mut browser,
        "api/live",
        "if (window.answers % 2) { view.devices.cam.state = 'lost'; view.devices.cam.error = 'no cable'; } view.devices.tagger.state = 'lost'; view.devices.tagger.error = 'no light';",
    );
    browser.until("window.answers > 15");
    assert_eq!(
        browser.run("sunglint.alarms.told"),
        json!(["lost cam", "not written", "lost tagger"])
    );
    assert_eq!(browser.run("[sunglint.alarms.beeps, window.devices]"), json!([2, 1]));
    assert_eq!(browser.complaints, Vec::<String>::new());
    // An answer that this page cannot take.
    changed(&mut browser, "api/live", "view.counts = 7; view.events = null;");
    browser
        .until("document.getElementById('notice').innerText.startsWith('this page has a fault')");
    assert!(
        browser.complaints.iter().any(|text| text.contains("TypeError")),
        "{:?}",
        browser.complaints
    );
    browser.run("window.fetch = window.fetched");
    browser.until("document.getElementById('mode').innerText === 'live' && document.getElementById('notice').innerText === ''");
    // Marks of another frame are neither drawn nor told.
    changed(&mut browser, "api/marks", "view.start_s += 0.01; view.place_px = [1, 1];");
    browser.until("window.answers > 3 && sunglint.marks.place_px[0] === 1");
    assert_eq!(browser.run("sunglint.marks.of === sunglint.frame.of"), false);
    assert!(!browser.text("#measured").contains("target at 1.0, 1.0"));
    browser.run("window.fetch = window.fetched");
    browser.until("sunglint.marks?.of === sunglint.marks?.start_s && sunglint.marks?.of === sunglint.frame.of");
    // Killed.
    serving.child.kill().unwrap();
    browser.until("sunglint.alarms.told.at(-1) === 'silent'");
    assert!(
        browser.text("#alarm").contains("the program has not answered since"),
        "{}",
        browser.text("#alarm")
    );
    assert_eq!(browser.run("[sunglint.alarms.beeps, window.devices]"), json!([3, 1]));
}

/// Colours before the first picture. Truth: the attribute that colours everything is there before any script of the page but the one in its head has run; the list of choices in red light is drawn by the
/// page where the browser lets it, and has no other colour.
#[test]
fn a_red_page_does_not_flash() {
    let Some(mut browser) = Browser::start("a_red_page_does_not_flash") else { return };
    let folder = Folder::new("page-red");
    Recording { frame_px: 16, ..Recording::default() }.write(&folder.path("night"));
    let serving =
        Serving::start(&folder, &["page", "night", "--no-open", "--address", "127.0.0.1:0"]);
    browser.open(&serving.url);
    browser.run("(() => { const t = document.getElementById('theme'); t.value = 'red'; t.dispatchEvent(new Event('change')); })()");
    let look = "document.addEventListener('readystatechange', () => { if (document.readyState === 'interactive') window.first = [document.documentElement.dataset.theme, getComputedStyle(document.documentElement).backgroundColor, document.querySelector('meta[name=color-scheme]')?.content]; })";
    browser.call("Page.addScriptToEvaluateOnNewDocument", json!({"source": look}));
    browser.open(&serving.url);
    assert_eq!(browser.run("window.first"), json!(["red", "rgb(0, 0, 0)", "dark"]));
    if browser.run("CSS.supports('appearance', 'base-select')") == true {
        browser.click("#theme");
        browser.until("document.getElementById('theme').matches(':open')");
        let colours = browser.run("(() => { const o = document.querySelectorAll('#theme option'); return [...o].flatMap((e) => { const s = getComputedStyle(e); return [s.color, s.backgroundColor]; }); })()");
        for colour in colours.as_array().unwrap() {
            let text = colour.as_str().unwrap();
            let parts: Vec<f64> = text
                .trim_start_matches(|c: char| !c.is_ascii_digit())
                .trim_end_matches(')')
                .split(", ")
                .map(|part| part.parse().unwrap())
                .collect();
            assert!(
                parts.get(3) == Some(&0.0) || parts[1].max(parts[2]) <= 0.45 * parts[0].max(1.0),
                "{text}"
            );
        }
        browser.shot(&crate::page::pictures().join("choices_red.png"));
    }
    assert_eq!(browser.complaints, Vec::<String>::new());
}

/// A recorded session with a second camera (synthetic: the first one's frames, without the last ten), a log of 7,000 notes, and five lines of it that nobody can read. Truth: by hand.
#[test]
fn several_cameras_and_a_long_log() {
    let Some(mut browser) = Browser::start("several_cameras_and_a_long_log") else { return };
    let folder = Folder::new("page-several");
    let root = folder.path("night");
    Recording { seconds: 120.0, frame_px: 120, ..Recording::default() }.write(&root);
    let manifest = root.join("session.toml");
    let text = std::fs::read_to_string(&manifest).unwrap();
    let begin = text.find("name = \"cam\"").unwrap();
    let begin = text[..begin].rfind("[[").unwrap();
    let end = text[begin + 2..].find("[[").map_or(text.len(), |at| begin + 2 + at);
    let guide = text[begin..end].replace("\"cam\"", "\"guide\"");
    std::fs::write(
        &manifest,
        format!("{}{}\n{guide}\n{}", &text[..begin], &text[begin..end].trim_end(), &text[end..]),
    )
    .unwrap();
    let mut own = 0;
    for hour in std::fs::read_dir(root.join("frames/cam")).unwrap() {
        let hour = hour.unwrap().path();
        let to = root.join("frames/guide").join(hour.file_name().unwrap());
        std::fs::create_dir_all(&to).unwrap();
        let mut files: Vec<_> =
            std::fs::read_dir(&hour).unwrap().map(|file| file.unwrap().path()).collect();
        files.sort();
        own += files.len();
        for file in &files[..files.len() - 10] {
            std::fs::copy(file, to.join(file.file_name().unwrap())).unwrap();
        }
    }
    let log = root.join("events.jsonl");
    let text = std::fs::read_to_string(&log).unwrap();
    let (first, end) = text.trim_end().rsplit_once('\n').unwrap();
    let mut lines = format!("{first}\n");
    for i in 0..7000 {
        let utc = sunglint_formats::time::format_utc(
            crate::common::night::at(50.0 + 0.005 * f64::from(i)),
            3,
        );
        lines += &format!(
            "{{\"utc\":\"{utc}\",\"kind\":\"control\",\"action\":\"note\",\"text\":\"note {i}\"}}\n"
        );
    }
    let at = |s: f64| sunglint_formats::time::format_utc(crate::common::night::at(s), 3);
    lines += &format!(
        "{{\"utc\":\"{}\",\"kind\":\"device_lost\",\"device\":\"cam\",\"error\":\"no cable\",\"again_in_s\":1.0}}\n",
        at(90.0)
    );
    for _ in 0..5 {
        lines += "{\"utc\":\"yesterday\",\"kind\":\"control\",\"action\":\"note\",\"text\":\"\"}\n";
    }
    std::fs::write(&log, lines + end + "\n").unwrap();
    let serving =
        Serving::start(&folder, &["page", "night", "--no-open", "--address", "127.0.0.1:0"]);
    browser.open(&serving.url);
    browser.until("sunglint.frame !== null");
    // All of the log, a part of it in the list, which follows the time.
    let notes = "sunglint.events.filter((e) => e.text.startsWith('note: note ')).length";
    assert_eq!(browser.run(notes), 7000);
    browser.run("document.activeElement.blur()");
    browser.key("Home");
    browser.until("document.getElementById('events').innerText.includes('note 10') && !document.getElementById('events').innerText.includes('note 6990')");
    browser.until("document.querySelector('#devices tbody').innerText.includes('not opened')");
    browser.key("End");
    browser.until("document.getElementById('events').innerText.includes('note 6990')");
    assert!(browser.run("document.querySelectorAll('#events li').length").as_u64().unwrap() <= 602);
    // The 7,000th event is of the devices, too.
    browser.until("document.querySelector('#devices tbody').innerText.includes('lost') || document.querySelector('#devices tbody').innerText.includes('ended')");
    browser.run("(() => { const s = document.getElementById('slider'); s.value = '95'; s.dispatchEvent(new Event('input')); })()");
    browser.until("document.querySelector('#devices tbody').innerText.includes('lost')");
    browser.run("document.querySelector('#events li.more button').click()");
    browser.settle();
    assert!(!browser.text("#events").contains("note 6990"));
    // All warnings, not three.
    let warnings = browser.run("sunglint.about.warnings.length").as_u64().unwrap();
    assert!(warnings >= 5, "{warnings}");
    assert_eq!(browser.run("document.querySelectorAll('#warnings li').length"), warnings);
    assert_eq!(browser.text("#warnings summary"), format!("{warnings} warnings"));
    // The fibres lie on the camera that the station describes: their names are written on its frames alone, wherever they lie.
    browser.run("(() => { const own = CanvasRenderingContext2D.prototype.fillText; window.written = []; CanvasRenderingContext2D.prototype.fillText = function (text, ...more) { if (this.canvas.id === 'image') window.written.push(text); return own.call(this, text, ...more); }; })()");
    let written = |browser: &mut Browser| {
        for _ in 0..2 {
            browser.run("(() => { window.written = []; const m = document.getElementById('marks'); m.checked = !m.checked; m.dispatchEvent(new Event('change')); })()");
            browser.settle();
        }
        browser.run("sunglint.about.fibres.filter((fibre) => window.written.includes(fibre.channel)).length")
    };
    let fibres = browser.run("sunglint.about.fibres.length");
    assert!(fibres.as_u64() > Some(0));
    assert_eq!(written(&mut browser), fibres);
    let choose = |name: &str| {
        format!(
            "(() => {{ const s = document.getElementById('camera'); s.value = '{name}'; s.dispatchEvent(new Event('change')); }})()"
        )
    };
    // The first camera's film comes late.
    browser.run("(() => { const before = window.fetch; window.fetch = async (where, ...more) => { if (String(where).includes('frames/cam')) await new Promise((done) => setTimeout(done, 800)); return before(where, ...more); }; })()");
    browser.run(&format!("{}; {}", choose("cam"), choose("guide")));
    browser.until("sunglint.frame?.camera === 'guide'");
    std::thread::sleep(Duration::from_millis(1200));
    assert_eq!(
        browser.run("[sunglint.camera, sunglint.frame.camera, sunglint.film.number.length]"),
        json!(["guide", "guide", own - 10])
    );
    assert_eq!(written(&mut browser), 0);
    // Space opens what it stands on, and starts no film.
    browser.run("document.querySelector('#clip summary').focus()");
    let space = json!({"type": "keyDown", "key": " ", "code": "Space", "text": " ", "windowsVirtualKeyCode": 32});
    browser.call("Input.dispatchKeyEvent", space);
    browser.call(
        "Input.dispatchKeyEvent",
        json!({"type": "keyUp", "key": " ", "code": "Space", "windowsVirtualKeyCode": 32}),
    );
    browser.until("document.getElementById('clip').open");
    assert_eq!(browser.run("sunglint.playing"), false);
    looks_good(&mut browser, "several");
    assert_eq!(browser.complaints, Vec::<String>::new());
}

/// A page that has only the last seconds of a night (synthetic: the older points are taken from its answers) shows all of it in larger points. Truth: the bins in the session, from the first on: none of the
/// night's beginning is missing, and the sum over the large points is theirs. Beside it the clock's state, the focus over the time, and what the plan's star should give.
#[test]
fn the_whole_night_is_on_the_page() {
    let Some(mut browser) = Browser::start("the_whole_night_is_on_the_page") else { return };
    let folder = Folder::new("page-whole");
    let mut serving = night(&folder, "127.0.0.1:0");
    browser.open(&serving.url);
    browser.until("sunglint.live.now_s > 25");
    changed(
        &mut browser,
        "api/live",
        "view.now_s += 100; const v = view.counts.tagger; if (v.start_s.length > 30) { for (const list of [v.start_s, v.length_s, v.flags, ...v.rate_hz, ...view.corrected_hz.tagger]) list.splice(0, list.length - 20); }",
    );
    // As after a long night: the small points are the last ones, and reach back by more than a minute.
    browser.run("Object.assign(sunglint, { counts: {}, seen: { events: sunglint.seen.events, counts: {} } })");
    browser.until("sunglint.counts.tagger?.start_s[0] > 20");
    browser.run("(() => { const s = document.getElementById('span'); s.value = 'all'; s.dispatchEvent(new Event('change')); })()");
    browser.until("sunglint.history.tagger !== undefined && sunglint.wideAt > 0");
    browser.until("document.getElementById('counts').plot.from < 2");
    let first = browser.run("sunglint.history.tagger.start_s.length").as_u64().unwrap();
    // It grows, and each time its last point is replaced by a larger one.
    browser.until(&format!("sunglint.history.tagger.start_s.length > {first} + 1"));
    let found = browser.run("(() => { const h = sunglint.history.tagger; return [h.start_s, h.length_s, h.rate_hz[0], h.low_hz[0], h.high_hz[0]]; })()");
    browser.until("!document.getElementById('clock-health').hidden && document.getElementById('clock-health').innerText.startsWith('clock: ')");
    // The simulated camera sees no star: there is nothing to draw.
    browser
        .until("sunglint.looks?.start_s.length > 2 && document.getElementById('looks-box').hidden");
    assert_eq!(browser.text("#notice"), "");
    assert_eq!(browser.run("sunglint.predicted.length"), 1, "Polaris has a curve");
    looks_good(&mut browser, "whole");
    assert_eq!(browser.complaints, Vec::<String>::new());
    browser.click("#stop");
    assert!(serving.child.wait().unwrap().success());
    let session = sunglint_formats::session::Session::open(folder.path("session")).unwrap();
    let all = crate::common::night::bins(&session);
    let lists: Vec<Vec<f64>> = found
        .as_array()
        .unwrap()
        .iter()
        .map(|list| list.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect())
        .collect();
    let [start_s, length_s, rate_hz, low_hz, high_hz] = <[Vec<f64>; 5]>::try_from(lists).unwrap();
    let points = start_s.iter().zip(length_s).zip(rate_hz).zip(low_hz.into_iter().zip(high_hz));
    let mut at = 0;
    // The last one grew on meanwhile.
    for (((from_s, length_s), rate_hz), (low_hz, high_hz)) in points.take(start_s.len() - 1) {
        let bins = (length_s / 0.1).round() as usize;
        let own = &all[at..at + bins];
        at += bins;
        let expected_s = (own[0].start - session.manifest().start_utc).to_seconds();
        assert!((from_s - expected_s).abs() < 1e-6, "{from_s} for {expected_s}");
        let counts: u64 = own.iter().map(|bin| bin.counts[0]).sum();
        assert!((rate_hz * length_s - counts as f64).abs() < 1e-6 * counts as f64 + 1e-6);
        let rates = own.iter().map(|bin| 10.0 * bin.counts[0] as f64);
        let (low, high) = rates.fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
        assert!((low_hz - low).abs() < 1e-6 * high && (high_hz - high).abs() < 1e-6 * high);
    }
    assert!(at > 200, "{at}");
}

/// A style or a program that did not come (the browser refuses them for a while, as a server that breaks the connection does) is asked for again by the page. Truth: the colours that
/// the browser computes, and the page's own word.
#[test]
fn files_of_the_page_that_did_not_come_are_asked_for_again() {
    let test = "files_of_the_page_that_did_not_come_are_asked_for_again";
    let Some(mut browser) = Browser::start(test) else { return };
    let folder = Folder::new("page-files");
    Recording { seconds: 20.0, frame_px: 40, ..Recording::default() }.write(&folder.path("night"));
    let args = ["page", "night", "--no-open", "--address", "127.0.0.1:0"];
    let serving = Serving::start(&folder, &args);
    browser.call("Network.enable", json!({}));
    let bare = "getComputedStyle(document.querySelector('.skip')).position === 'static'";
    for (file, lacks) in [
        ("page.css", bare),
        ("page.js", "document.getElementById('mode')?.innerText.toLowerCase() === 'connecting'"),
    ] {
        browser.call("Network.setBlockedURLs", json!({"urls": [format!("*/{file}")]}));
        browser.call("Page.navigate", json!({"url": "about:blank"}));
        browser.call("Page.navigate", json!({"url": serving.url.clone()}));
        browser.until(&format!("document.readyState === 'complete' && {lacks}"));
        browser.call("Network.setBlockedURLs", json!({"urls": []}));
        browser.until(&format!(
            "document.documentElement?.dataset.ready === 'yes' && !({bare}) && sunglint.frame !== undefined"
        ));
        browser.complaints.clear();
    }
}
