//! The first curve: a look at everything, descents from the best places and from their twins.

use super::AttitudeError;
use super::descent::Found;
use super::descent::Space;
use super::hunt::{Hunt, spread_out};
use super::look::Seen;
use super::question::Checkpoint;
use super::state::{Law, State};
use glam::DVec3;

/// Epochs of the first descents.
pub(super) const FIRST: usize = 64;
/// Epochs of the second descents.
pub(super) const SECOND: usize = 240;
/// Where the first descents start, of a usual search.
const STARTS: usize = 320;
/// Minima that are carried on.
pub(super) const CARRIED: usize = 24;
/// How much finer the search is then.
const FINER: usize = 2;
/// Where more than this is left over of the light, the search is made again, finer.
const POOR: f64 = 0.18;

/// Result of the search with the first curve alone.
pub(super) struct First {
    pub minima: Vec<Found>,
    pub surface: Vec<(DVec3, f64)>,
    pub simulated: usize,
    /// Whether so much of the light is left over that another attitude should be looked for.
    pub poor: bool,
    pub rates: usize,
}

impl Hunt<'_> {
    /// Minima by the longest curve alone.
    pub(super) fn first_curve(
        &self,
        law: &Law,
        from: Option<&Checkpoint>,
        finer: bool,
    ) -> Result<(First, Law), AttitudeError> {
        let order = self.order();
        let own = self.moments_of(&order[..1]);
        let law = self.law_about(law, &own);
        let few = spread_out(&own, FIRST, self.options.seed);
        let more = spread_out(&own, SECOND, self.options.seed + 1);
        let mut simulated = 0;
        let times = if finer { FINER } else { 1 };
        let seen = self.look(&law, &own, times, from)?;
        simulated += seen.simulated;
        let starts = self.starts(&law, &seen, STARTS * times)?;
        let space = Space::Logarithms { spread: 0.15 };
        let mut minima = self.descend(&law, &few, space, &starts, 15, "descents")?;
        minima.truncate(CARRIED);
        let twins = self.twins_of(&law, &minima[..minima.len().min(4)]);
        minima.extend(self.descend(&law, &few, space, &twins, 15, "twins")?);
        let minima = self.distinct(&law, minima, CARRIED);
        simulated += minima.iter().map(|m| m.simulated).sum::<usize>();
        let starts: Vec<State> = minima.iter().map(|m| m.state).collect();
        let wide =
            self.descend(&law, &more, Space::Logarithms { spread: 0.2 }, &starts, 20, "descents")?;
        simulated += wide.iter().map(|m| m.simulated).sum::<usize>();
        let starts: Vec<State> = wide.iter().map(|m| m.state).collect();
        let space = Space::Logarithms { spread: 0.07 };
        let mut minima = self.descend(&law, &more, space, &starts, 20, "descents")?;
        let twins = self.twins_of(&law, &minima[..minima.len().min(3)]);
        minima.extend(self.descend(&law, &more, space, &twins, 20, "twins")?);
        let minima = self.distinct(&law, minima, CARRIED / 2);
        simulated += minima.iter().map(|m| m.simulated).sum::<usize>();
        let best = minima.first().ok_or(AttitudeError::NoMinimum)?;
        let descent = self.descent(&law, &more, space);
        let samples = descent.samples(&mut self.forward.eye(), &best.state)?;
        let poor = self.left_over(&samples) > POOR;
        let Seen { surface, rates, .. } = seen;
        Ok((First { minima, surface, simulated, poor, rates }, law))
    }
}
