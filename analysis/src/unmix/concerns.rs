//! Concerns that a user should know before believing weights.

use super::{Mixing, State, Unmixed};

/// A condition number of more is warned of.
const CONDITION: f64 = 100.0;

/// Why samples have no weights, with their numbers.
pub fn reasons(found: &[Unmixed]) -> String {
    let reasons = [
        (State::NO_DATA, "without a valid value in any band"),
        (State::BELOW_HORIZON, "below the horizon"),
        (State::ALIKE, "with bands in which endmembers are black or alike"),
        (State::NOT_UNIQUE, "where many answers fit alike"),
    ];
    let counted = reasons.iter().filter_map(|(state, words)| {
        let n = found.iter().filter(|u| u.mixture.is_none() && u.state.contains(*state)).count();
        (n > 0).then(|| format!("{n} {words}"))
    });
    counted.collect::<Vec<_>>().join(", ")
}

/// Warnings about a matrix of bands and endmembers: too few bands, endmembers that are nearly alike.
pub fn concerns(mixing: &Mixing, bands: &[String], endmembers: &[String]) -> Vec<String> {
    let mut concerns = Vec::new();
    let (channels, count) = (bands.len(), endmembers.len());
    if channels < count {
        concerns.push(format!(
            "{channels} channels for {count} endmembers: where light of all of them is possible, many answers fit alike; such samples get no weights"
        ));
    } else if !mixing.is_complete() {
        concerns.push(format!(
            "the {channels} channels tell {} of {count} endmembers apart",
            mixing.rank
        ));
    }
    if mixing.condition.is_finite() && mixing.condition > CONDITION {
        let twins = mixing.nearest.as_ref().map_or(String::new(), |twins| {
            let [a, b] = twins.pair;
            format!(
                "; nearest to each other are {} and {}, {:.2}° apart",
                endmembers[a],
                endmembers[b],
                twins.angle_rad.to_degrees()
            )
        });
        concerns.push(format!(
            "the endmembers are nearly collinear: relative errors of rates may grow {:.0}-fold{twins}",
            mixing.condition
        ));
    }
    concerns
}
