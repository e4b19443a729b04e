//! A night, captured: played back, killed, on a full disk, with a device that vanishes; and what a plan may not say.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::common::night::{Fakes, Recording, at, bins, frames, lost_between, plan_of, positive};
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};
use sunglint::observe::replayed;
use sunglint_drivers::clock::Cancel;
use sunglint_formats::session::{Session, Severity, What};
use sunglint_formats::toml::Finite;
use sunglint_formats::{CountFlags, CountRecord};
use sunglint_observatory::live::Seen;
use sunglint_observatory::{Control, LiveState, Plan, Summary};
use sunglint_testkit::Campaign;

fn run_replay(session: &Path, output: &Path) -> Summary {
    let night = replayed(session, true, Some(output)).unwrap();
    night.run(&Cancel::new(), &mut |_| {}).unwrap()
}

/// Truth: the recorded session itself: each bin, each frame with its header, each stay at a target. Exact.
#[test]
fn a_replayed_night_is_the_recorded_one() {
    let folder = Folder::new("replay");
    let old = Recording { seconds: 120.0, ..Recording::default() }.write(&folder.0.join("old"));
    let summary = run_replay(old.root(), &folder.0.join("new"));
    let new = Session::open(folder.0.join("new")).unwrap();
    assert_eq!((summary.not_written, summary.losses["cam"], summary.losses["tagger"]), (0, 0, 0));
    assert_eq!(bins(&new), bins(&old));
    assert_eq!(bins(&new).len(), 1200);
    assert_eq!(frames(&new), frames(&old));
    assert_eq!(new.visits().unwrap(), old.visits().unwrap());
    assert_eq!(new.visits().unwrap().len(), 2);
    assert!(new.check().unwrap().is_whole(), "{:?}", new.check().unwrap());
    // Once more, from the copy, by the program.
    let text = folder.done(&["observe", "--replay", "new", "--fast", "-o", "third", "--json"]);
    let last: serde_json::Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    assert_eq!((&last["kind"], &last["taken"]["tagger"]), (&"end".into(), &1200.into()));
    assert_eq!(bins(&Session::open(folder.0.join("third")).unwrap()), bins(&old));
    folder.done(&["session", "check", "third"]);
}

/// A terminal that goes away (SIGHUP, its pipes closed) does not end a night unless that was asked for; then the session ends in good order.
#[test]
fn a_lost_terminal_ends_no_night() {
    let folder = Folder::new("hangup");
    let old = Recording { seconds: 4.0, ..Recording::default() }.write(&folder.0.join("old"));
    for ends in [false, true] {
        let root = folder.0.join(if ends { "ended" } else { "went-on" });
        let mut arguments = vec!["observe", "--every", "0.05", "--replay"];
        if ends {
            arguments.push("--end-on-hangup");
        }
        // The session follows --replay.
        arguments.sort_by_key(|a| *a == "--replay");
        let mut program = Command::new(env!("CARGO_BIN_EXE_sunglint"))
            .args(&arguments)
            .arg(old.root())
            .arg("-o")
            .arg(&root)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let limit = Instant::now() + Duration::from_secs(60);
        while !root.join("session.toml").exists() {
            assert!(Instant::now() < limit, "the session's folder was not made within a minute");
            std::thread::sleep(Duration::from_millis(2));
        }
        std::thread::sleep(Duration::from_millis(300));
        // Nobody reads any more: every print fails from here on.
        drop((program.stdout.take(), program.stderr.take()));
        let id = program.id().to_string();
        assert!(Command::new("kill").args(["-HUP", &id]).status().unwrap().success());
        assert_eq!(program.wait().unwrap().code(), Some(0), "{ends}");
        let session = Session::open(&root).unwrap();
        assert!(session.check().unwrap().ended);
        let all = bins(&session).len() == bins(&old).len();
        assert_eq!(all, !ends, "{} bins", bins(&session).len());
    }
}

/// Kills the program after `after` of a night that is played at speed, and gives how many bins and frames are lost that it had
/// said to have for more than a second, and how many are doubled or changed.
fn killed(folder: &Path, recorded: &Session, name: &str, after: Duration) -> [usize; 2] {
    let root = folder.join(name);
    let mut program = Command::new(env!("CARGO_BIN_EXE_sunglint"))
        .args(["observe", "--json", "--every", "0.05", "--replay"])
        .arg(recorded.root())
        .arg("-o")
        .arg(&root)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let said = BufReader::new(program.stdout.take().unwrap());
    let listener = std::thread::spawn(move || {
        let lines = said.lines().map_while(Result::ok);
        let taken = |line: String| {
            let line: serde_json::Value = serde_json::from_str(&line).ok()?;
            let of = |name: &str| Some(line["devices"][name]["taken"].as_u64()? as usize);
            Some((Instant::now(), [of("tagger")?, of("cam")?]))
        };
        lines.filter_map(taken).collect::<Vec<_>>()
    });
    let limit = Instant::now() + Duration::from_secs(60);
    while !root.join("session.toml").exists() {
        assert!(Instant::now() < limit, "the session's folder was not made within a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
    std::thread::sleep(after);
    let now = Instant::now();
    // SIGKILL.
    program.kill().unwrap();
    program.wait().unwrap();
    let said = listener.join().unwrap();
    let old_enough =
        |(then, _): &&(Instant, _)| now.saturating_duration_since(*then) > Duration::from_secs(1);
    let safe = said.iter().rfind(old_enough).map_or([0, 0], |(_, taken)| *taken);
    let session = Session::open(&root).unwrap();
    let report = session.check().unwrap();
    let bad = |text: &str| text.contains("CRC") || text.contains("were safe");
    assert!(!report.findings.iter().any(|finding| bad(&finding.text)), "{report:?}");
    assert!(!report.ended);
    lost_between(recorded, &session, safe)
}

/// Truth: the recorded night, and what the program itself had said to have a second before it was killed (SIGKILL): all of that is there,
/// once, as it was. The kernel lives on, so that this shows what the program holds back, not what the disk does: for that see the injected power
/// failures in formats/tests/session.rs.
#[test]
fn campaign_kill_night() {
    let folder = Folder::new("kill");
    let recorded = Recording { seconds: 6.0, bin_s: 0.01, frame_s: 0.05, ..Recording::default() }
        .write(&folder.0.join("old"));
    let mut campaign = Campaign::start("kill_night", 200);
    let seeds: Vec<u64> = campaign.seeds().collect();
    // From right after the start to 3.2 s, spread evenly by the golden ratio.
    let time = |seed: u64| Duration::from_secs_f64(3.2 * (seed as f64 * 0.618_034).fract());
    let results: Vec<[usize; 2]> = std::thread::scope(|scope| {
        let (folder, recorded, seeds) = (&folder.0, &recorded, &seeds);
        let workers: Vec<_> = (0..4_usize)
            .map(|worker| {
                scope.spawn(move || {
                    let own = seeds.iter().skip(worker).step_by(4);
                    own.map(|&seed| killed(folder, recorded, &format!("k{seed}"), time(seed)))
                        .collect::<Vec<_>>()
                })
            })
            .collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
    });
    campaign.largest("lost_older_than_1_s", results.iter().map(|r| r[0]).max().unwrap() as f64);
    campaign.largest("doubled", results.iter().map(|r| r[1]).max().unwrap() as f64);
    campaign.finish();
}

/// Truth: the faults that the test makes: the counter fails after 100 bins, cannot be opened twice, and comes back. Waits double from 1 s
/// (virtual: nobody waits). The camera misses nothing: 60 frames of a turn each 2 s.
#[test]
fn a_device_that_vanishes_comes_back_and_the_other_goes_on() {
    let folder = Folder::new("vanish");
    let fakes = Fakes { fail_after: Some(100), refuse: 2, ..Fakes::new(120.0) };
    let summary = fakes.night(&folder.0.join("s")).run(&Cancel::new(), &mut |_| {}).unwrap();
    assert_eq!(summary.taken["cam"], 60);
    let session = Session::open(folder.0.join("s")).unwrap();
    let events: Vec<What> = session.events().unwrap().map(|event| event.unwrap().what).collect();
    let waits: Vec<f64> = events
        .iter()
        .filter_map(|what| match what {
            What::DeviceLost { device, again_in_s, .. } if device == "tagger" => Some(*again_in_s),
            _ => None,
        })
        .collect();
    assert_eq!(waits, [1.0, 2.0, 4.0]);
    let back = events.iter().find_map(|what| match what {
        What::DeviceBack { device, after_s } => Some((device.clone(), *after_s)),
        _ => None,
    });
    // 1 + 2 + 4 s of waiting and the first bin, 0.1 s.
    let (device, after_s) = back.unwrap();
    assert!(device == "tagger" && (after_s - 7.1).abs() < 1e-6, "{after_s}");
    let bins = bins(&session);
    let gaps: Vec<usize> =
        (0..bins.len()).filter(|&i| bins[i].flags.contains(CountFlags::GAP)).collect();
    assert_eq!(gaps, [100]);
    // 120 s less the 7 s of waiting.
    assert_eq!(bins.len(), 1130);
    assert_eq!(frames(&session).len(), 60);
    let whole = session.check().unwrap();
    assert!(whole.is_whole() && whole.counters[0].flagged_gaps == 1, "{whole:?}");
}

/// Truth: a camera that never opens: the counter's bins are all there, and the summary names the camera.
#[test]
fn a_device_that_never_comes_holds_up_no_other() {
    let folder = Folder::new("never");
    let fakes = Fakes { no_camera: true, ..Fakes::new(60.0) };
    let summary = fakes.night(&folder.0.join("s")).run(&Cancel::new(), &mut |_| {}).unwrap();
    assert_eq!((summary.silent, summary.taken["tagger"]), (vec!["cam".to_owned()], 600));
    assert_eq!(bins(&Session::open(folder.0.join("s")).unwrap()).len(), 600);
}

/// Truth: the plan: frames name the target of their middle, the log the times of the schedule.
#[test]
fn frames_and_log_name_the_planned_targets() {
    let folder = Folder::new("targets");
    Fakes::new(60.0).night(&folder.0.join("s")).run(&Cancel::new(), &mut |_| {}).unwrap();
    let session = Session::open(folder.0.join("s")).unwrap();
    let visits = session.visits().unwrap();
    let found: Vec<_> = visits.iter().map(|v| (v.target.name.as_str(), v.from, v.to)).collect();
    let expected = [("sky", at(0.0), Some(at(20.0))), ("Vega", at(20.0), Some(at(50.0)))];
    assert_eq!(found, expected);
    for (_, frame) in frames(&session) {
        let middle = frame.start + hifitime::Duration::from_seconds(0.5 * frame.exposure_s);
        let expected = match middle {
            utc if utc < at(20.0) => "sky",
            utc if utc < at(50.0) => "Vega",
            _ => "none",
        };
        assert_eq!(frame.header.text("OBJECT"), Some(expected));
        assert_eq!(frame.header.text("FILTER"), Some("V"));
        // Vega's place (Hipparcos, J2000.0) within precession-free aberration, 20.5 arcseconds.
        if expected == "Vega" {
            assert!((frame.header.real("RA").unwrap() - 279.2347).abs() < 0.02);
            assert!((frame.header.real("DEC").unwrap() - 38.7837).abs() < 0.006);
        }
    }
}

/// Truth: Ctrl-C's token: the session ends at once and whole.
#[test]
fn a_stopped_night_is_whole() {
    let folder = Folder::new("stop");
    let cancel = Cancel::new();
    let mut looks = 0;
    let night = Fakes { real_time: true, ..Fakes::new(600.0) }.night(&folder.0.join("s"));
    let begun = Instant::now();
    let summary = night
        .run(&cancel.clone(), &mut |_| {
            looks += 1;
            if looks == 10 {
                cancel.cancel();
            }
        })
        .unwrap();
    assert!(summary.stopped && begun.elapsed() < Duration::from_secs(30));
    let session = Session::open(folder.0.join("s")).unwrap();
    let ended = session.events().unwrap().map(Result::unwrap).last().unwrap().what;
    assert!(matches!(ended, What::End { .. } | What::Sync { .. }), "{ended:?}");
    assert!(session.check().unwrap().is_whole(), "{:?}", session.check().unwrap());
}

/// Truth: a tmpfs of 2 MiB, too small for the frames of the night (60 of 80 kB): the program says so, fails, and what was written stays, all bins with it. Needs root.
#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_said_and_spoils_nothing() {
    let test = "a_full_disk_is_said_and_spoils_nothing";
    let folder = Folder::new("full");
    let recorded = Recording { seconds: 60.0, frame_px: 200, ..Recording::default() }
        .write(&folder.0.join("old"));
    let small = folder.0.join("small");
    std::fs::create_dir(&small).unwrap();
    let system = |arguments: &[&str]| {
        let run = Command::new(arguments[0]).args(&arguments[1..]).arg(&small).output();
        run.is_ok_and(|output| output.status.success())
    };
    if !system(&["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs"]) {
        sunglint_testkit::skip(test, "a tmpfs can only be mounted by root");
        return;
    }
    let output = folder.run(&["observe", "--replay", "old", "--fast", "-o", "small/s"]);
    let check = folder.run(&["session", "check", "small/s", "--json"]);
    let session = Session::open(small.join("s"));
    let read = session.as_ref().map(|session| (bins(session), frames(session)));
    assert!(system(&["umount"]), "the test's tmpfs could not be taken away");
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("frames of cam are left out"), "{message}");
    assert!(message.contains("not be written"), "{message}");
    assert_eq!(check.status.code(), Some(1));
    let (new_bins, new_frames) = read.unwrap();
    let (old_bins, old_frames) = (bins(&recorded), frames(&recorded));
    assert!(
        new_frames.len() >= 15 && new_frames.len() < old_frames.len(),
        "{}: {message}",
        new_frames.len()
    );
    assert!(new_frames.iter().all(|frame| old_frames.contains(frame)));
    // The summary has both numbers.
    let summary = String::from_utf8_lossy(&output.stdout);
    let both = format!("cam 60, of which {} are on the disk", new_frames.len());
    assert!(summary.contains(&both), "{both}: {summary}");
    // The bins come first: not one is missing.
    assert_eq!(new_bins, old_bins);
}

/// Runs `act` on a disk of so many MB, a tmpfs; `None` where none can be mounted.
#[cfg(target_os = "linux")]
fn on_disk<R>(place: &Path, megabytes: u64, act: impl FnOnce() -> R) -> Option<R> {
    std::fs::create_dir(place).unwrap();
    let done = |command: &mut Command| command.output().is_ok_and(|output| output.status.success());
    let size = format!("size={megabytes}m");
    if !done(Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(place)) {
        return None;
    }
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(act));
    assert!(done(Command::new("umount").arg(place)), "the test's tmpfs could not be taken away");
    Some(result.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
}

/// A virtual night of half as much again as a disk holds, on disks of 4 and 10 MB; as a campaign on disks of 4, 10, 30 and 100 MB. Truth: the plan: a bin each 0.1 s from the first to the last moment, none lost; frames are, and are counted.
/// The start warns of the disk. Needs root.
#[test]
#[cfg(target_os = "linux")]
fn campaign_small_disks() {
    let whole = std::env::var("SUNGLINT_CAMPAIGN").is_ok_and(|name| name == "small_disks");
    let sizes: &[u64] = if whole { &[4, 10, 30, 100] } else { &[4, 10] };
    for megabytes in sizes {
        let folder = Folder::new(&format!("disk-{megabytes}"));
        // Frames of 0.5 MB, one each 0.5 s.
        let seconds = (1.5 * *megabytes as f64).ceil();
        let plan = format!(
            "station = \"ufo\"\nfrom = \"2020-11-18T18:00:00Z\"\nvirtual = \"virtual.toml\"\n[[camera]]\nname = \"cam\"\ndevice = \"virtual\"\nexposure_s = 0.4\ninterval_s = 0.5\n\
             window_px = [400, 300, 500, 500]\n[[counter]]\nname = \"tagger\"\ndevice = \"virtual\"\nchannels = {{ id400 = 1, spcm = 2 }}\nbin_s = 0.1\n[[visit]]\noff = \"sky\"\nfor_s = {seconds}\n"
        );
        std::fs::write(folder.0.join("night.toml"), plan).unwrap();
        std::fs::write(folder.0.join("virtual.toml"), "").unwrap();
        let place = folder.0.join("disk");
        let found = on_disk(&place, *megabytes, || {
            let output = folder.run(&["observe", "night.toml", "-o", "disk/s"]);
            let session = Session::open(place.join("s")).unwrap();
            (output, bins(&session), frames(&session).len())
        });
        let Some((output, bins, frames)) = found else {
            sunglint_testkit::skip("campaign_small_disks", "a tmpfs can only be mounted by root");
            return;
        };
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(message.contains("GB are free"), "{megabytes}: {message}");
        assert_eq!(output.status.code(), Some(1), "{megabytes}: {message}");
        assert!(message.contains("frames of cam are left out"), "{megabytes}: {message}");
        let expected = (10.0 * seconds) as usize;
        assert_eq!(bins.len(), expected, "{megabytes}: {message}");
        let gaps = bins.windows(2).filter(|w| w[1].start_ps != w[0].start_ps + w[0].length_ps);
        assert_eq!(gaps.count(), 0, "{megabytes}");
        // At least half of what fits beside the reserve is used.
        assert!(frames * 4 >= *megabytes as usize, "{megabytes}: {frames} frames");
        eprintln!("{megabytes} MB: {} bins, {frames} of {} frames", bins.len(), 2.0 * seconds);
    }
}

/// Truth: a limit of the system for the size of files (`ulimit -f`, 60 blocks of 0.5 or 1 kB), below that of a frame (80 kB): the program outlives the signal that comes with it, says what is the matter, and fails in good order.
#[test]
#[cfg(unix)]
fn a_file_that_may_not_grow_is_said() {
    let folder = Folder::new("long-files");
    Recording { seconds: 10.0, frame_px: 200, ..Recording::default() }.write(&folder.0.join("old"));
    let program = env!("CARGO_BIN_EXE_sunglint");
    let command = format!("ulimit -f 60; exec {program} observe --replay old --fast -o s");
    let run = Command::new("sh").args(["-c", &command]).current_dir(&folder.0).output().unwrap();
    let message = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(1), "{message}");
    assert!(message.contains("File too large"), "{message}");
    assert!(frames(&Session::open(folder.0.join("s")).unwrap()).is_empty());
}

/// Truth: the grammar of docs/night.md: each mistake is named with its line and what is right.
#[test]
fn a_plan_says_what_is_wrong_with_it() {
    let folder = Folder::new("plan");
    let good = plan_of(&[]);
    let path = folder.0.join("night.toml");
    std::fs::write(&path, &good).unwrap();
    let plan = Plan::read(&path).unwrap();
    assert_eq!((plan.cameras.len(), plan.counters.len()), (1, 1));
    assert_eq!(plan.counters[0].channel_names(), ["g", "r"]);
    assert_eq!(plan.to, Some(at(60.0)));
    for (from, to, expected) in [
        ("exposure_s = 0.5", "exposure_ms = 500", "multiply the value by 0.001"),
        ("interval_s = 2.0", "interval_s = 2.0\nbinning = 7", "a `window_px` beside it"),
        ("interval_s = 2.0", "interval_s = 2.0\nbinning = 0", "expected 1 or more"),
        ("interval_s = 2.0", "intervall_s = 2.0", "did you mean `interval_s`?"),
        ("interval_s = 2.0", "interval_s = 0.2", "expected the exposure or more, 0.5 s"),
        ("\"sim-camera\"", "\"sim-camra\"", "nearest: sim-camera"),
        ("\"sim-camera\"", "\"sim-timetagger\"", "expected a camera; this is a photon counter"),
        ("name = \"cam\"", "name = \"../cam\"", "letters, digits, - and _"),
        ("name = \"cam\"", "name = \"tagger\"", "letters, digits, - and _"),
        ("r = 3", "r = 1", "an input of its own"),
        ("star = \"Vega\"", "star = \"Wega\"", "a star of the catalogue"),
        ("star = \"Vega\"", "ra_deg = 3", "both `ra_deg` and `dec_deg`"),
        ("star = \"Vega\"", "star = \"Vega\"\noff = \"sky\"", "expected one target"),
        ("for_s = 30", "for_s = 30\nto = \"now\"", "either `to` or `for_s`"),
        ("for_s = 20", "", "a time: the visit before has no end"),
        ("station = \"ufo\"", "station = \"ofu\"", "a built-in station (ufo, gauss6)"),
    ] {
        assert!(good.contains(from), "{from}");
        std::fs::write(&path, good.replacen(from, to, 1)).unwrap();
        let error = format!("{:#}", anyhow::Error::from(Plan::read(&path).unwrap_err()));
        assert!(error.contains(expected), "{to}: {error}");
        assert!(error.contains("night.toml:"), "{to}: {error}");
    }
}

/// Truth: simulated devices at the other end of their protocols, live for two seconds: frames on their grid, bins without a gap. The plan is for now, day or night, so its
/// pre-flight is overruled.
#[test]
fn the_program_observes_with_simulated_devices() {
    let folder = Folder::new("live");
    let plan = plan_of(&[("from = \"2020-11-18T17:00:00Z\"", ""), ("for_s = 60", "for_s = 3")]);
    std::fs::write(folder.0.join("night.toml"), plan).unwrap();
    let text =
        folder.done(&["observe", "night.toml", "--anyway", "--json", "--every", "0.5", "-o", "s"]);
    let lines: Vec<serde_json::Value> =
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(lines.len() >= 4 && lines.iter().any(|line| line["kind"] == "status"));
    folder.done(&["session", "check", "s"]);
    let session = Session::open(folder.0.join("s")).unwrap();
    let bins: Vec<CountRecord> = bins(&session);
    assert!(bins.len() >= 10, "{}", bins.len());
    assert!(bins.windows(2).all(|b| b[1].start_ps == b[0].start_ps + b[0].length_ps));
    assert!(!frames(&session).is_empty());
    let report = session.check().unwrap();
    assert!(report.findings.iter().all(|f| f.severity == Severity::Note));
    let kinds: Vec<What> = session.events().unwrap().map(|event| event.unwrap().what).collect();
    let devices = kinds.iter().filter(|what| matches!(what, What::Device { .. })).count();
    assert_eq!(devices, 2);
}

/// A night that is killed in a visit goes on in its own folder: one visit, one series of bins and of frame numbers, nothing twice. Truth: by hand: the plan's visit ends
/// 14 s after its beginning with 60 frames at most; what was there before the kill is there byte by byte; the hole in the bins lasts from the kill to the resumption
/// and 3 s at most (simulated devices open at once).
#[test]
fn a_killed_night_goes_on_in_its_folder() {
    let folder = Folder::new("resume");
    let plan = "station = \"ufo\"\nfor_s = 16\n\
        [[camera]]\nname = \"cam\"\ndevice = \"sim-camera\"\nexposure_s = 0.1\n\
        [[counter]]\nname = \"tagger\"\ndevice = \"sim-timetagger\"\nchannels = { g = 1, r = 2 }\nbin_s = 0.1\nraw_tags = true\n\
        [[visit]]\nstar = \"Polaris\"\nfor_s = 14\nframes = 60\nexposure_s = 0.05\ninterval_s = 0.15\n";
    std::fs::write(folder.0.join("night.toml"), plan).unwrap();
    let start = |arguments: &[&str]| {
        let program = Command::new(env!("CARGO_BIN_EXE_sunglint"))
            .args(arguments)
            .current_dir(&folder.0)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        program.unwrap()
    };
    let mut program = start(&["observe", "night.toml", "--anyway", "-o", "night"]);
    std::thread::sleep(Duration::from_secs(5));
    // Nobody else writes into a night that is being written.
    let error = folder.refused(1, &["observe", "--resume", "night"]);
    assert!(error.contains("another process writes it"), "{error}");
    program.kill().unwrap();
    program.wait().unwrap();
    let killed = Instant::now();
    let root = folder.0.join("night");
    let (log, table) = (root.join("events.jsonl"), root.join("counts/tagger.ecsv"));
    let before = Session::open(&root).unwrap();
    let [old_bins, old_frames] = [bins(&before).len(), frames(&before).len()];
    assert!(old_bins > 20 && old_frames > 10, "{old_bins} bins, {old_frames} frames");
    // As a kill may leave them: half a line at the end.
    for path in [&log, &table] {
        let mut text = std::fs::read(path).unwrap();
        text.extend_from_slice(b"2026-11-2");
        std::fs::write(path, text).unwrap();
    }
    let old_tags = std::fs::read(root.join("tags/tagger.tags")).unwrap();
    let down = killed.elapsed();
    let mut program = start(&["observe", "--resume", "night"]);
    assert!(program.wait().unwrap().success());
    folder.done(&["session", "check", "night"]);
    let session = Session::open(&root).unwrap();
    let visits = session.visits().unwrap();
    assert_eq!(
        visits.iter().map(|v| (v.target.name.as_str(), v.number)).collect::<Vec<_>>(),
        [("Polaris", 1)]
    );
    let all = bins(&session);
    assert_eq!(all[..old_bins], bins(&before)[..old_bins]);
    let gaps: Vec<f64> = all
        .windows(2)
        .map(|pair| (pair[1].start - pair[0].start).to_seconds())
        .filter(|step| *step > 0.15)
        .collect();
    assert_eq!(gaps.len(), 1, "{gaps:?}");
    assert!(gaps[0] < down.as_secs_f64() + 1.0 + 3.0, "{gaps:?} s, down for {down:?}");
    let marked: Vec<usize> =
        (0..all.len()).filter(|k| all[*k].flags.contains(CountFlags::GAP)).collect();
    assert!(marked.contains(&old_bins), "{marked:?}, {old_bins} before");
    let numbers: Vec<u64> = frames(&session).iter().map(|(number, _)| *number).collect();
    let mut alone = numbers.clone();
    alone.dedup();
    assert_eq!(alone, numbers);
    // Sixty of the visit, not sixty more.
    let vega = |frame: &&(u64, sunglint_formats::Frame)| {
        frame.1.header.text("OBJECT").is_some_and(|name| name.trim() == "Polaris")
    };
    assert_eq!(frames(&session).iter().filter(vega).count(), 60);
    let tags = std::fs::read(root.join("tags/tagger.tags")).unwrap();
    let whole = old_tags.len() / 16 * 16;
    assert!(tags.len() > whole && tags[..whole] == old_tags[..whole]);
    let resumed = session.events().unwrap().filter(|event| {
        matches!(event.as_ref().unwrap().what, What::Resume { cut_bytes, .. } if cut_bytes >= 18)
    });
    assert_eq!(resumed.count(), 1);
    // By its plan it is over now.
    std::thread::sleep(Duration::from_secs(6));
    let error = folder.refused(1, &["observe", "--resume", "night"]);
    assert!(error.contains("nothing is left"), "{error}");
}

/// A person wishes for a gain that the camera refuses: the camera goes on as planned, and says so. Truth: the log and the frames: the gain of the plan before and after, frames of the
/// wish where it can be had, none lost.
#[test]
fn a_wish_that_the_camera_refuses_costs_no_night() {
    let folder = Folder::new("wish");
    let fakes = Fakes { real_time: true, most_gain: 100.0, ..Fakes::new(600.0) };
    let mut night = fakes.night(&folder.path("session"));
    let camera = &mut night.cameras[0];
    camera.gain = Finite::new(10.0);
    camera.exposure_s = positive(0.02);
    camera.interval_s = Some(positive(0.05));
    let live = Arc::new(LiveState::new());
    night.live = Some(live.clone());
    let cancel = Cancel::new();
    let token = cancel.clone();
    let running = std::thread::spawn(move || night.run(&token, &mut |_| {}).unwrap());
    let until = |what: &str, is_it: &dyn Fn() -> bool| {
        let begun = Instant::now();
        while !is_it() {
            assert!(begun.elapsed() < Duration::from_secs(60), "{what}");
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    let last = || live.last_frame("cam").map_or((0, None), |(n, f)| (n, f.header.real("GAIN")));
    let wish = |gain: f64| {
        let (camera, gain) = ("cam".to_owned(), Finite::new(gain));
        let asked = live.ask(Control::Expose { camera, exposure_s: None, gain }).unwrap();
        asked.recv_timeout(Duration::from_secs(30)).unwrap().unwrap();
    };
    until("the first frames", &|| last().0 >= 3 && last().1 == Some(10.0));
    wish(50.0);
    until("frames of the wish", &|| last().1 == Some(50.0));
    wish(500.0);
    let told = || {
        let view = live.since(&Seen::default()).unwrap();
        view.events.iter().any(|event| event.text.contains("as planned again"))
    };
    until("the refusal", &told);
    let then = last().0;
    until("frames as planned", &|| last().0 > then + 3 && last().1 == Some(10.0));
    cancel.cancel();
    let summary = running.join().unwrap();
    assert_eq!((summary.failed.len(), summary.losses["cam"], summary.refused["cam"]), (0, 0, 0));
    assert!(summary.check().is_ok());
    let session = Session::open(folder.path("session")).unwrap();
    let numbers: Vec<u64> = frames(&session).into_iter().map(|(number, _)| number).collect();
    assert_eq!(numbers, (1..=numbers.len() as u64).collect::<Vec<_>>());
    assert!(session.check().unwrap().is_whole());
}
