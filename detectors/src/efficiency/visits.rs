//! The places of a run in their order: dark readings, the reference wavelength, the wavelengths of the scan.

use super::line::Part;
use super::plan::{At, DarkBy, Measuring};

/// A place of the run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Visit {
    /// Part.
    pub part: Part,
    /// Number within it.
    pub number: u32,
    /// Wavelength to which the monochromator goes, nm; none where it stays.
    pub nm: Option<f64>,
    /// Slot of the wheel; none where it stays, or there is none.
    pub slot: Option<u32>,
}

/// Numbers of dark readings and of the reference from here on are those after a run went on.
pub(super) const RESUMED: u32 = 1_000_000;

/// A dark reading.
pub(super) fn dark(plan: &Measuring, number: u32) -> Visit {
    let (nm, slot) = match plan.dark {
        DarkBy::Slot(slot) => (None, Some(slot)),
        DarkBy::Wavelength(nm) => (Some(nm), None),
        DarkBy::Hand => (None, None),
    };
    Visit { part: Part::Dark, number, nm, slot }
}

/// A reading of the reference.
pub(super) fn reference(at: At, number: u32) -> Visit {
    Visit { part: Part::Reference, number, nm: Some(at.nm), slot: at.slot }
}

/// All places of a run.
#[must_use]
pub fn visits(plan: &Measuring) -> Vec<Visit> {
    let mut all = Vec::with_capacity(plan.wavelengths.len() + 4);
    let (mut darks, mut references) = (0, 0);
    let mut check = |all: &mut Vec<Visit>, is_dark: bool, is_reference: bool| {
        if is_dark {
            all.push(dark(plan, darks));
            darks += 1;
        }
        if let Some(at) = plan.reference.filter(|_| is_reference) {
            all.push(reference(at, references));
            references += 1;
        }
    };
    for (k, at) in plan.wavelengths.iter().enumerate() {
        let due = |every: u32| k % every.max(1) as usize == 0;
        check(&mut all, due(plan.dark_every), due(plan.reference_every));
        let (nm, slot) = (Some(at.nm), at.slot);
        all.push(Visit { part: Part::Step, number: k as u32, nm, slot });
    }
    check(&mut all, true, true);
    all
}
