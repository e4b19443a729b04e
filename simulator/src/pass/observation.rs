//! Samples that have a target and a site each of their own: single observations, of any number of bodies of one kind.

use super::{Pass, PassError};
use hifitime::Epoch;
use std::sync::Arc;
use sunglint_ephemeris::orbit::Orbit;
use sunglint_formats::time::{format_utc, tai_nanoseconds};
use sunglint_radiometry::sky::Site;

/// Times that differ by less belong together, ns: a Julian date in a double is good to 40 µs.
const SAME_NS: i128 = 1_000_000;

/// Target and site of one sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Name of the object; may be empty.
    pub object: String,
    /// Place of the target.
    pub orbit: Orbit,
    /// Site in place of the station's.
    pub site: Option<Site>,
}

impl Pass {
    /// Name of what is observed; the number of objects where the samples are of several.
    pub fn object(&self) -> String {
        let mut names: Vec<&str> = self.observations.iter().map(|o| o.object.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        match names.as_slice() {
            [] => self.orbit.name(),
            [one] => (*one).to_owned(),
            several => format!("{} objects", several.len()),
        }
    }

    /// Orbit and site of a sample.
    pub(super) fn of_sample<'a>(
        &'a self,
        sample: usize,
        common: &'a Orbit,
    ) -> (&'a Orbit, &'a Site) {
        match self.observations.get(sample) {
            Some(own) => (&own.orbit, own.site.as_ref().unwrap_or(&self.station.site)),
            None => (common, &self.station.site),
        }
    }

    /// The same pass at the times of a measured curve, in their order; exposures in s.
    ///
    /// A pass of single observations ([`Pass::observations`]) is known at its own moments alone: each time is given the row of the same moment (within 1 ms), and of
    /// several rows of one moment the first, second … in the order of `file_rows`, the places of the samples in their file. Such rows keep the scene's exposures.
    ///
    /// # Errors
    /// [`PassError::Input`] for a time without a row; for rows of one moment that are more, or fewer, than the samples.
    pub fn at_times(
        self,
        times: Vec<Epoch>,
        exposure_s: Vec<f64>,
        file_rows: &[usize],
    ) -> Result<Self, PassError> {
        if self.observations.is_empty() {
            return Ok(Self { times, exposure_s, ..self });
        }
        let rows = self.rows_of(&times, file_rows)?;
        Ok(Self {
            observations: rows.iter().map(|r| self.observations[*r].clone()).collect(),
            exposure_s: rows.iter().map(|r| self.exposure_s[*r]).collect(),
            times: rows.iter().map(|r| self.times[*r]).collect(),
            ..self
        })
    }

    /// For each time the row of the table of observations.
    fn rows_of(&self, times: &[Epoch], file_rows: &[usize]) -> Result<Vec<usize>, PassError> {
        let wrong = |needs, found| Err(PassError::Input { needs, found });
        if file_rows.len() != times.len() {
            let found = format!("{} of {}", file_rows.len(), times.len());
            return wrong("the place of each sample in its file", found);
        }
        let own: Vec<i128> = self.times.iter().map(|t| tai_nanoseconds(*t)).collect();
        let asked: Vec<i128> = times.iter().map(|t| tai_nanoseconds(*t)).collect();
        let mut scene: Vec<usize> = (0..own.len()).collect();
        scene.sort_by_key(|i| (own[*i], *i));
        let mut curve: Vec<usize> = (0..asked.len()).collect();
        curve.sort_by_key(|i| (asked[*i], file_rows[*i]));
        let mut rows = vec![usize::MAX; times.len()];
        let (mut s, mut c) = (0, 0);
        while c < curve.len() {
            let at = asked[curve[c]];
            // Rows and samples of one moment.
            while s < scene.len() && own[scene[s]] < at - SAME_NS {
                s += 1;
            }
            let here = |list: &[usize], of: &[i128]| {
                list.iter().take_while(|i| of[**i] <= at + SAME_NS).count()
            };
            let (theirs, ours) = (here(&scene[s..], &own), here(&curve[c..], &asked));
            if theirs == 0 {
                let found =
                    format!("{}: the table has no row within 1 ms", format_utc(times[curve[c]], 3));
                return wrong("measured times that are rows of [times] table", found);
            }
            if theirs != ours {
                let found = format!(
                    "{}: {ours} samples and {theirs} rows; which belong together is not known",
                    format_utc(times[curve[c]], 3)
                );
                return wrong("as many samples as rows of [times] table in one moment", found);
            }
            // Of one moment: in the order of the two files.
            let mut same_rows = scene[s..s + theirs].to_vec();
            same_rows.sort_unstable();
            let mut samples = curve[c..c + ours].to_vec();
            samples.sort_by_key(|i| file_rows[*i]);
            for (sample, row) in samples.iter().zip(same_rows) {
                rows[*sample] = row;
            }
            (s, c) = (s + theirs, c + ours);
        }
        Ok(rows)
    }

    /// The observations of some samples, in that order; none where the pass has none.
    pub fn observations_of(&self, samples: impl Iterator<Item = usize>) -> Vec<Arc<Observation>> {
        if self.observations.is_empty() {
            return Vec::new();
        }
        samples.map(|i| self.observations[i].clone()).collect()
    }
}
