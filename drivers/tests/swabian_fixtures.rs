//! The recorded conversations of `fixtures/swabian`: each replays strictly and ends as it says.
//!
//! They were recorded from our simulated bridge (synthetic), on a virtual clock, so that they are the same each time;
//! `SUNGLINT_UPDATE=1` records them anew.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, SystemClock, VirtualClock};
use sunglint_drivers::recording::{Event, Fault, Header, Recorded, Recording, Replay, play};
use sunglint_drivers::simulated::swabian::{Simulated, TaggerSpec, Trouble};
use sunglint_drivers::tags::Tag;
use sunglint_formats::atomic::Overwrite;
use sunglint_testkit::fixture;

const MS: i64 = 1_000_000_000;

/// A photon of channel 1 every 20 ms, of channel 2 every 50 ms.
fn calm(_: &[i32], from_ps: i64, to_ps: i64, into: &mut Vec<Tag>) {
    let mut all: Vec<Tag> = (0..100).map(|i| Tag::photon(1, i * 20 * MS + 7 * MS)).collect();
    all.extend((0..40).map(|i| Tag::photon(2, i * 50 * MS + 11 * MS)));
    all.sort_by_key(|tag| tag.time_ps);
    into.extend(all.iter().filter(|tag| (from_ps..to_ps).contains(&tag.time_ps)));
}

/// The same with all that may come beside photons, both in the bins and among the tags: an overflow with missed events
/// (from 0.15 s to 0.25 s and from 0.52 s to 0.54 s), an error, a time twice, and times that go back.
fn bad(channels: &[i32], from_ps: i64, to_ps: i64, into: &mut Vec<Tag>) {
    let mut all = Vec::new();
    calm(channels, from_ps, to_ps, &mut all);
    all.extend([
        Tag::overflow_begin(150 * MS),
        Tag::missed_events(2, 700, 250 * MS),
        Tag::missed_events(1, 40, 250 * MS),
        Tag::overflow_end(250 * MS),
        Tag::error(380 * MS),
        Tag::overflow_begin(520 * MS),
        Tag::overflow_end(540 * MS),
        Tag::missed_events(-3, 65_535, 540 * MS),
        Tag::photon(1, 541 * MS),
        Tag::photon(1, 541 * MS),
        Tag::error(542 * MS),
    ]);
    all.retain(|tag| (from_ps..to_ps).contains(&tag.time_ps));
    all.sort_by_key(|tag| tag.time_ps);
    into.extend(all);
    if (from_ps..to_ps).contains(&(542 * MS)) {
        into.push(Tag::photon(2, 540 * MS));
    }
}

fn refusing(code: &str, text: &str) -> Trouble {
    let operation = if code == "no_module" { "hello" } else { "open" };
    Trouble { refuse: Some((operation.into(), code.into(), text.into())), ..Trouble::default() }
}

/// Name, light, what is wrong, and how it must end.
fn cases() -> Vec<(&'static str, bool, Trouble, String)> {
    let five = "[5, 2, 0] missed [0, 0, 0] ";
    let good = Trouble::default;
    vec![
        (
            "good",
            false,
            good(),
            format!("{}; 4 records, 4 photons, 0 overflows, 0 missed, 0 errors, 0 unsorted", [five; 5].join("; ")),
        ),
        (
            "bad_night",
            true,
            good(),
            format!(
                "{five}; {five}OVERFLOW; [5, 2, 0] missed [40, 700, 0] OVERFLOW+MISSED; {five}ERROR; {five}; \
                 11 records, 7 photons, 1 overflows, 65535 missed, 1 errors, 1 unsorted"
            ),
        ),
        ("dies", false, Trouble { dies_after: Some(8), ..good() }, "after 2 bins: gone".into()),
        (
            "half_frame",
            false,
            Trouble { half_frame: Some(7), ..good() },
            "after 1 bins: no answer".into(),
        ),
        (
            "wrong_length",
            false,
            Trouble { wrong_length: Some(7), ..good() },
            "after 1 bins: Time Tagger: the checksum of frame 7 is ".into(),
        ),
        (
            "twice",
            false,
            Trouble { twice: Some(1), ..good() },
            "after 2 bins: Time Tagger: a bin at 110000000000 ps after one that ended at 210000000000 ps".into(),
        ),
        ("gap", false, Trouble { dropped: Some(1), ..good() }, format!("{five}; {five}GAP; ")),
        (
            "wrong_version",
            false,
            Trouble { version: Some(2), ..good() },
            "open: Time Tagger refused hello: it speaks version Some(2), not 1; bridge and program have to be of one version"
                .into(),
        ),
        (
            "no_module",
            false,
            refusing("no_module", "ModuleNotFoundError: No module named 'Swabian'"),
            "open: Time Tagger refused hello: ModuleNotFoundError: No module named 'Swabian'; install".into(),
        ),
        (
            "no_device",
            false,
            refusing("no_device", "No Time Tagger attached or already in use."),
            "open: Time Tagger refused open: No Time Tagger attached or already in use; plug it in".into(),
        ),
        (
            "no_licence",
            false,
            refusing("no_licence", "No license file found or no Time Tagger connected."),
            "open: Time Tagger refused open: No license file found or no Time Tagger connected; the maker's".into(),
        ),
        (
            "no_server",
            false,
            refusing("no_server", "Could not connect to Time Tagger server at lab:41101."),
            "open: Time Tagger refused open: Could not connect to Time Tagger server at lab:41101; start".into(),
        ),
        ("silent", false, Trouble { silent: true, ..good() }, "open: no answer".into()),
    ]
}

fn simulated(is_bad: bool, trouble: Trouble) -> Simulated {
    let light = if is_bad { bad } else { calm };
    let mut line = Simulated::new(TaggerSpec::default(), light);
    line.trouble = trouble;
    line
}

/// Truth: the named ends above, by hand from the light; the recordings in the repository, byte for byte.
#[test]
fn every_recording_ends_as_it_says() {
    for (name, is_bad, trouble, end) in cases() {
        let path = fixture(&format!("swabian/{name}.rec"));
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        if std::env::var_os("SUNGLINT_UPDATE").is_some() {
            let header = Header {
                device: "Time Tagger Ultra behind the bridge".into(),
                source: "sunglint's simulated bridge".into(),
                host: Some("sunglint's Swabian driver".into()),
                recorded: None,
                synthetic: true,
            };
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            let line = simulated(is_bad, trouble);
            let line = Recorded::create(line, &path, &header, Overwrite::Allow).unwrap();
            let found = crate::common::swabian::session(line, &clock);
            assert!(found.starts_with(&end), "recording {name}:\n{found}\n{end}");
        }
        let recording = Recording::read(&path).unwrap();
        assert!(recording.header.synthetic, "{name} was made up, and says so");
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        let mut line = Replay::new(recording);
        let found = crate::common::swabian::session(&mut line, &clock);
        assert!(found.starts_with(&end), "{name}:\n{found}\n{end}");
        line.finish().unwrap_or_else(|error| panic!("{name}: {error}"));
    }
}

/// The same files through a real socket, on the computer's clock. Truth: the same ends, but for tags that a busy computer
/// reads later than the 60 ms.
#[test]
fn the_same_recordings_through_a_socket() {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    std::thread::scope(|scope| {
        for (name, is_bad, _, end) in cases() {
            let clock = &clock;
            scope.spawn(move || {
                let recording = Recording::read(fixture(&format!("swabian/{name}.rec"))).unwrap();
                let (host, mut device) = crate::common::tcp();
                let last = recording.events.last().map(|(_, event)| event.clone());
                let goes = last == Some(Event::Fault(Fault::Disconnect));
                let player = std::thread::spawn(move || {
                    let played = play(&recording, &mut device, &crate::common::within(20.0));
                    // What arrives together with a hang-up may be lost with it.
                    std::thread::sleep(Duration::from_millis(50));
                    (played, (!goes).then_some(device))
                });
                let found = crate::common::swabian::session(host, clock);
                let bins = end.split("; ").take(if is_bad || name == "good" { 5 } else { 1 });
                let bins = bins.collect::<Vec<_>>().join("; ");
                assert!(found.starts_with(&bins), "{name} through a socket:\n{found}\n{end}");
                player.join().unwrap().0.unwrap();
            });
        }
    });
}
