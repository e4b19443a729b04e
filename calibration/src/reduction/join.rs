//! One light curve out of those of several instruments.

use hifitime::Epoch;
use sunglint_radiometry::light_curve::{ChannelCurve, Flags, LightCurve, Samples};

/// A row of the union: when, for how long, and which sample of each curve it is.
struct Row {
    time: Epoch,
    exposure_s: f64,
    of: Vec<Option<usize>>,
}

/// Curves of instruments that ran side by side as one: its rows are all exposures of all of them, in the order of time, and a channel without
/// an exposure of its own in a row is NaN there with [`Flags::NOT_SAMPLED`]. Exposures of the same time and length share a row; two of one
/// instrument never do. Kind, provenance and metadata are those of the first curve; geometry is left out.
///
/// `None` without a curve, or where two curves have a channel of the same name (the name is then the error).
pub fn join(curves: &[LightCurve]) -> Result<LightCurve, String> {
    let Some(first) = curves.first() else { return Err("no curve".into()) };
    let mut rows: Vec<Row> = Vec::new();
    for (c, curve) in curves.iter().enumerate() {
        rows.extend((0..curve.len()).map(|i| {
            let mut of = vec![None; curves.len()];
            of[c] = Some(i);
            Row { time: curve.samples.time[i], exposure_s: curve.samples.exposure_s[i], of }
        }));
    }
    // Stable: of one time and length the earlier curve comes first.
    rows.sort_by(|a, b| a.time.cmp(&b.time).then(a.exposure_s.total_cmp(&b.exposure_s)));
    let rows = rows.into_iter().fold(Vec::new(), fold);
    let mut joined = LightCurve {
        kind: first.kind,
        samples: Samples {
            time: rows.iter().map(|row| row.time).collect(),
            exposure_s: rows.iter().map(|row| row.exposure_s).collect(),
            ..Samples::default()
        },
        channels: Vec::new(),
        provenance: first.provenance.clone(),
        other: first.other.clone(),
    };
    for (c, curve) in curves.iter().enumerate() {
        for channel in &curve.channels {
            if joined.channel(&channel.name).is_some() {
                return Err(channel.name.clone());
            }
            joined.channels.push(spread(channel, rows.iter().map(|row| row.of[c])));
        }
    }
    Ok(joined)
}

/// Puts a row to those before it: into the last one where that is the same exposure of other instruments.
fn fold(mut rows: Vec<Row>, row: Row) -> Vec<Row> {
    if let Some(last) = rows.last_mut()
        && last.time == row.time
        && last.exposure_s == row.exposure_s
        && last.of.iter().zip(&row.of).all(|(a, b)| a.is_none() || b.is_none())
    {
        for (mine, its) in last.of.iter_mut().zip(row.of) {
            *mine = mine.or(its);
        }
    } else {
        rows.push(row);
    }
    rows
}

/// A channel over the rows of the union.
fn spread(channel: &ChannelCurve, rows: impl Iterator<Item = Option<usize>>) -> ChannelCurve {
    let mut spread = ChannelCurve {
        name: channel.name.clone(),
        rate_hz: Vec::new(),
        sigma_hz: Vec::new(),
        flags: Vec::new(),
        model_error_hz: None,
        common_sigma_hz: channel.common_sigma_hz.as_ref().map(|_| Vec::new()),
    };
    for row in rows {
        let (rate, sigma, flags) = match row {
            Some(i) => (channel.rate_hz[i], channel.sigma_hz[i], channel.flags[i]),
            None => (f64::NAN, f64::NAN, Flags::NOT_SAMPLED),
        };
        if let (Some(into), Some(common)) = (&mut spread.common_sigma_hz, &channel.common_sigma_hz)
        {
            into.push(row.map_or(f64::NAN, |i| common[i]));
        }
        spread.rate_hz.push(rate);
        spread.sigma_hz.push(sigma);
        spread.flags.push(flags);
    }
    spread
}

#[cfg(test)]
mod tests {
    use super::*;
    use hifitime::Unit;
    use sunglint_formats::time::parse_utc;
    use sunglint_radiometry::light_curve::{Provenance, RateKind};

    fn curve(name: &str, seconds: &[f64], exposure_s: f64) -> LightCurve {
        let start = parse_utc("2020-11-18T17:00:00").unwrap();
        let time = seconds.iter().map(|s| start + *s * Unit::Second).collect();
        let n = seconds.len();
        LightCurve {
            kind: RateKind::Linear,
            samples: Samples::new(time, exposure_s),
            channels: vec![ChannelCurve {
                name: name.into(),
                rate_hz: seconds.to_vec(),
                sigma_hz: vec![1.0; n],
                flags: vec![Flags::empty(); n],
                model_error_hz: None,
                common_sigma_hz: None,
            }],
            provenance: Provenance::default(),
            other: sunglint_formats::Meta::default(),
        }
    }

    /// Truth: the union by hand. 0.1 s bins at 0, 0.1, 0.2 beside 0.5 s frames at 0.1 and 0.3, and a second counter with a bin at 0.1 alone:
    /// the counters' bins share a row, the frames do not, although one has the same middle.
    #[test]
    fn rows_are_the_union_of_all_exposures() {
        let curves = [
            curve("spcm", &[0.0, 0.1, 0.2], 0.1),
            curve("r", &[0.3, 0.1], 0.5),
            curve("mppc", &[0.1], 0.1),
        ];
        let joined = join(&curves).unwrap();
        assert_eq!(joined.samples.exposure_s, [0.1, 0.1, 0.5, 0.1, 0.5]);
        let rates = |name: &str| {
            let channel = joined.channel(name).unwrap();
            let rates = channel.rate_hz.iter().zip(&channel.flags);
            rates
                .map(|(rate, flags)| (*flags != Flags::NOT_SAMPLED).then_some(*rate))
                .collect::<Vec<_>>()
        };
        assert_eq!(rates("spcm"), [Some(0.0), Some(0.1), None, Some(0.2), None]);
        assert_eq!(rates("r"), [None, None, Some(0.1), None, Some(0.3)]);
        assert_eq!(rates("mppc"), [None, Some(0.1), None, None, None]);
        // The schema takes it.
        assert!(joined.to_table().is_ok());
    }

    #[test]
    fn a_sample_that_comes_twice_stays_twice() {
        let joined = join(&[curve("a", &[0.0, 0.0], 0.1), curve("b", &[0.0], 0.1)]).unwrap();
        assert_eq!(joined.len(), 2);
        let sampled = |name: &str| {
            let channel = joined.channel(name).unwrap();
            channel.flags.iter().filter(|f| f.is_empty()).count()
        };
        assert_eq!((sampled("a"), sampled("b")), (2, 1));
    }

    #[test]
    fn one_name_in_two_instruments_is_refused() {
        let twice = [curve("a", &[0.0], 0.1), curve("a", &[1.0], 0.1)];
        assert_eq!(join(&twice).unwrap_err(), "a");
        assert!(join(&[]).is_err());
    }
}
