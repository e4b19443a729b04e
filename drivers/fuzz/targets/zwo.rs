//! The wheel's reports: no panic; what is read keeps its promises.

use sunglint_drivers::zwo::report::{Info, Position, Request};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    if let Ok(position) = Position::parse(bytes) {
        assert!(position.arrived().is_none_or(|slot| (1..=position.count).contains(&slot)));
        assert_eq!(Position::parse(&position.emit()), Ok(position));
    }
    if let Ok(info) = Info::parse(bytes) {
        assert!(!info.name.is_empty() && info.name.len() <= 8);
    }
    if let Some(request) = Request::parse(bytes) {
        assert_eq!(request.emit()[..], *bytes);
    }
}
