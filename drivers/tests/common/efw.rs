//! The recorded conversations with a filter wheel: what the host does, what is wrong, and how it must end.
#![allow(dead_code, reason = "each test uses its part")]

use super::words::words;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline};
use sunglint_drivers::device::FilterWheel as _;
use sunglint_drivers::simulated::efw::{Efw, EfwSettings, Kind};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::transport::Transfers;
use sunglint_drivers::zwo::{Wheel, WheelSettings};

/// Does what the host does in every case: it opens the wheel and turns it to slot 3. Returns how that ended, in words.
pub fn session(hid: impl Transfers, clock: &Arc<dyn Clock>) -> String {
    let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
    // Short polls: a fake device answers at once, whatever time has passed.
    let settings = WheelSettings {
        poll: Duration::from_millis(100),
        slot_within: Duration::from_millis(1500),
        ..WheelSettings::default()
    };
    let mut wheel = match Wheel::open(hid, settings, &within(5)) {
        Ok(wheel) => wheel,
        Err(error) => return format!("open: {}", words(&error)),
    };
    match wheel.select(3, &within(10)) {
        Ok(slot) => format!("slot {slot} of {}", wheel.slots()),
        Err(interrupted) => format!("at {:?}: {}", interrupted.done, words(&interrupted.error)),
    }
}

pub struct Case {
    pub name: &'static str,
    pub faults: Vec<Fault<Kind>>,
    pub end: &'static str,
}

impl Case {
    pub fn hid(&self) -> Efw {
        let per_slot = Duration::from_millis(400);
        let mut wheel = Efw::new(EfwSettings { per_slot, ..EfwSettings::default() });
        wheel.faults = Script::new(self.faults.clone());
        wheel
    }

    /// Whether a fake device can show it: none stays silent or goes away, and what the host asks must not depend on time.
    pub fn is_for_umockdev(&self) -> bool {
        ["good", "fault_6", "error_number", "spoilt_once", "spoilt"].contains(&self.name)
    }
}

fn fault(name: &'static str, on: &str, nth: u32, kind: Kind, end: &'static str) -> Case {
    Case { name, faults: vec![Fault::new(on, nth, kind)], end }
}

pub fn cases() -> Vec<Case> {
    let error = vec![1, 0x7e, 0x5a, 1, 1, 5, 2, 1, 2, 7, 0, 0, 0, 0, 0x30, 0];
    let noise = vec![1, 0x7e, 0x5a, 4, 1, 0, 2, 2];
    vec![
        Case { name: "good", faults: Vec::new(), end: "slot 3 of 7" },
        fault(
            "fault_6",
            "move",
            2,
            Kind::Jam,
            "at None: ZWO filter wheel refused slot 3: it is in its fault state: free the wheel, cut its power and give it back (code 12)",
        ),
        fault(
            "error_number",
            "position",
            4,
            Kind::Say(error),
            "at None: ZWO filter wheel refused slot 2: it is in its fault state: free the wheel, cut its power and give it back (code 5)",
        ),
        fault(
            "never_arrives",
            "move",
            2,
            Kind::Endless,
            "at None: turning by a slot took too long",
        ),
        fault("not_heard", "move", 1, Kind::Deaf, "at Some(1): turning by a slot took too long"),
        fault("spoilt_once", "position", 3, Kind::Say(noise.clone()), "slot 3 of 7"),
        fault(
            "spoilt",
            "position",
            0,
            Kind::Say(noise),
            "open: ZWO filter wheel: the answer to Position: found `01 7e 5a 04 01 00 02 02`, expected 16 bytes that begin with 01 7e 5a 01, with slots from 1 to their number",
        ),
        fault("silent_once", "position", 3, Kind::Silence, "slot 3 of 7"),
        fault("silence", "position", 0, Kind::Silence, "open: no answer but 0 bytes"),
        fault("disconnect", "move", 2, Kind::Unplug, "at None: gone after 0 bytes"),
    ]
}
