//! The focuser against `indi_simulator_focus` (1.9.9 in Debian 12), live.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::indi::{Server, live, within};
use sunglint_drivers::device::{Device as _, DeviceError, Focuser as _};
use sunglint_drivers::indi::{Focuser, SessionSettings, devices};

/// Truth: the simulator's positions, 0 to 100,000 from 50,000 at first, and what it was told; it says `Ok` with the old position at times.
#[test]
fn a_focuser_goes_where_it_is_sent() {
    live("a_focuser_goes_where_it_is_sent", || {
        let server = Server::start(&["focus"]);
        let (name, settings) = ("Focuser Simulator", SessionSettings::default());
        let mut focuser = Focuser::open(server.connect(), name, settings, &within(20.0)).unwrap();
        assert_eq!(focuser.range(), [0, 100_000]);
        assert_eq!(focuser.position(&within(5.0)).unwrap(), 50_000);
        for position in [36_700, 36_700, 40_000, 39_999] {
            assert_eq!(focuser.move_to(position, &within(60.0)).unwrap(), position);
            assert_eq!(focuser.position(&within(5.0)).unwrap(), position);
        }
        let beyond = focuser.move_to(100_001, &within(5.0)).unwrap_err();
        assert!(matches!(*beyond.error, DeviceError::OutOfRange { .. }), "{beyond}");
        assert!(focuser.settings(&within(5.0)).unwrap().len() >= 2);
        let late = focuser.move_to(0, &within(0.05)).unwrap_err();
        assert!(!matches!(*late.error, DeviceError::NotStopped { .. }), "{late}");
        let listed = devices(server.connect(), settings, &within(20.0)).unwrap();
        assert_eq!(listed[0].is, [false, false, false, false, true]);
    });
}
