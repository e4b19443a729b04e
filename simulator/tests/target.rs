//! Targets: files, built-in ones, hinges.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use sunglint_simulator::target::Target;

/// `built_in` says `None` for names that it does not know, and for no others.
#[test]
fn every_built_in_target_is_read_without_a_warning() {
    for name in Target::built_in_names() {
        let text = Target::built_in_text(name).unwrap();
        let target = Target::parse(name, text).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((target.name.as_str(), &target.warnings[..]), (name, &[][..]));
        assert_eq!(Target::built_in(name).unwrap().parts.len(), target.parts.len());
    }
    assert!(Target::built_in("box_wings").is_none());
}
