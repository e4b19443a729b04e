//! A counter that counts the photons of a virtual night.

use super::camera::at;
use crate::observatory::watch::Watch;
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{
    Device, DeviceError, Identity, Interrupted, Origin, PhotonCounter, Setting, Value,
};
use sunglint_formats::{CountFlags, CountRecord};

const DEVICE: &str = "virtual counter";
const PS_PER_NS: i64 = 1000;

/// The counter of a virtual night. Its clock is that of the deadlines, and its bins end before they are given.
#[derive(Debug)]
pub struct VirtualCounter {
    watch: Watch,
    names: Vec<String>,
    /// Their numbers among the station's channels.
    channels: Vec<usize>,
    levels_v: Vec<f64>,
    /// Length of a bin and begin of the next, ps.
    counting: Option<(i64, i64)>,
}

impl VirtualCounter {
    pub(super) fn new(watch: Watch, names: &[String]) -> Result<Self, DeviceError> {
        let counted: Vec<(usize, &str)> = (watch.counters().into_iter())
            .map(|i| (i, watch.night().channels[i].name.as_str()))
            .collect();
        let number = |name: &String| {
            let found = counted.iter().find(|(_, counted)| counted == name);
            found.map(|(i, _)| *i).ok_or_else(|| DeviceError::Unknown {
                name: "channel",
                asked: name.clone(),
                known: counted.iter().map(|(_, name)| *name).collect::<Vec<_>>().join(", "),
            })
        };
        let channels = names.iter().map(number).collect::<Result<Vec<_>, _>>()?;
        let levels_v = vec![0.5; names.len()];
        Ok(Self { watch, names: names.to_vec(), channels, levels_v, counting: None })
    }

    fn channel(&self, channel: usize) -> Result<usize, DeviceError> {
        if channel < self.names.len() {
            return Ok(channel);
        }
        let known = self.names.join(", ");
        Err(DeviceError::Unknown { name: "channel", asked: channel.to_string(), known })
    }

    /// The next bin, once it is over.
    fn bin(&mut self, deadline: &Deadline) -> Result<CountRecord, DeviceError> {
        let Some((bin_ps, start_ps)) = self.counting else {
            let reason = "it does not count: start it first";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        };
        let end_ps = start_ps + bin_ps;
        let end = Duration::from_nanos(end_ps.unsigned_abs().div_ceil(PS_PER_NS.unsigned_abs()));
        deadline
            .sleep(end.saturating_sub(deadline.now()))
            .map_err(|expired| DeviceError::expired(DEVICE, "counting", expired))?;
        let counts = self.watch.counts(&self.channels, start_ps..end_ps);
        self.counting = Some((bin_ps, end_ps));
        let begin = Duration::from_nanos(start_ps.unsigned_abs() / PS_PER_NS.unsigned_abs());
        Ok(CountRecord {
            start: at(self.watch.night().start, begin),
            start_ps,
            length_ps: bin_ps,
            missed: vec![0; counts.len()],
            counts,
            flags: CountFlags::empty(),
        })
    }
}

impl Device for VirtualCounter {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(Identity {
            vendor: "sunglint".into(),
            model: "virtual counter".into(),
            serial: Some(format!("seed {}", self.watch.night().options.seed)),
            firmware: Some(env!("CARGO_PKG_VERSION").into()),
            driver: "virtual",
        })
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let levels: Vec<String> =
            self.names.iter().zip(&self.levels_v).map(|(name, v)| format!("{name}={v}")).collect();
        let value = Value::Text(levels.join(" "));
        Ok(vec![Setting { name: "trigger_level_v", value, origin: Origin::ReadBack }])
    }
}

impl PhotonCounter for VirtualCounter {
    fn channels(&self) -> &[String] {
        &self.names
    }

    /// Kept, and without effect: the pulses of a virtual night are all alike.
    fn set_trigger_level_v(
        &mut self,
        channel: usize,
        level_v: f64,
        _: &Deadline,
    ) -> Result<f64, DeviceError> {
        let channel = self.channel(channel)?;
        if !(-2.5..=2.5).contains(&level_v) {
            let (name, least, most) = ("trigger_level_v", -2.5, 2.5);
            return Err(DeviceError::OutOfRange { name, asked: level_v, least, most });
        }
        self.levels_v[channel] = level_v;
        Ok(level_v)
    }

    /// Has none: gives 0.
    fn set_input_delay_ps(
        &mut self,
        channel: usize,
        _: i64,
        _: &Deadline,
    ) -> Result<i64, DeviceError> {
        self.channel(channel).map(|_| 0)
    }

    /// Has none of its own, the detectors have theirs: gives 0.
    fn set_dead_time_ps(
        &mut self,
        channel: usize,
        _: i64,
        _: &Deadline,
    ) -> Result<i64, DeviceError> {
        self.channel(channel).map(|_| 0)
    }

    fn start(&mut self, bin_ps: i64, deadline: &Deadline) -> Result<(), DeviceError> {
        if self.counting.is_some() {
            let reason = "it counts already: stop first";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        // A microsecond to an hour.
        let (least, most) = (1_000_000, 3_600_000_000_000_000);
        if !(least..=most).contains(&bin_ps) {
            let (least, most) = (least as f64, most as f64);
            return Err(DeviceError::OutOfRange {
                name: "bin_ps",
                asked: bin_ps as f64,
                least,
                most,
            });
        }
        let now_ns = i64::try_from(deadline.now().as_nanos()).unwrap_or(i64::MAX / PS_PER_NS);
        self.counting = Some((bin_ps, now_ns.saturating_mul(PS_PER_NS)));
        Ok(())
    }

    fn read(
        &mut self,
        bins: usize,
        deadline: &Deadline,
    ) -> Result<Vec<CountRecord>, Interrupted<Vec<CountRecord>>> {
        let mut records = Vec::new();
        for _ in 0..bins {
            match self.bin(deadline) {
                Ok(record) => records.push(record),
                Err(error) => return Err(Interrupted::new(records, error)),
            }
        }
        Ok(records)
    }

    fn stop(&mut self, _: &Deadline) -> Result<(), DeviceError> {
        self.counting = None;
        Ok(())
    }
}
