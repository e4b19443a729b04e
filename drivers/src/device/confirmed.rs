//! Readings that have to agree before they are believed.

use super::{Device, DeviceError, Identity, Power, PowerMeter, Setting};
use crate::clock::Deadline;

/// A power meter on a line without checksums (Ophir's), on which a spoilt digit is a wrong number: each reading is taken
/// until two in a row agree. For light that is steadier than `relative`.
#[derive(Debug)]
pub struct Confirmed<M> {
    meter: M,
    relative: f64,
    absolute_w: f64,
    most: u32,
}

impl<M: PowerMeter> Confirmed<M> {
    /// Two readings agree if they differ by at most `relative` of the larger, or `absolute_w`, W. At most `most` are taken.
    pub fn new(meter: M, relative: f64, absolute_w: f64, most: u32) -> Self {
        Self { meter, relative, absolute_w, most }
    }

    /// The meter itself.
    pub fn meter(&mut self) -> &mut M {
        &mut self.meter
    }

    /// The meter itself.
    pub fn into_meter(self) -> M {
        self.meter
    }

    fn agree(&self, one: &Power, other: &Power) -> bool {
        match (one, other) {
            (Power::Watts(a), Power::Watts(b)) => {
                (a - b).abs() <= (self.relative * a.abs().max(b.abs())).max(self.absolute_w)
            }
            (one, other) => one == other,
        }
    }
}

impl<M: PowerMeter> Device for Confirmed<M> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.meter.identity(deadline)
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        self.meter.settings(deadline)
    }

    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        self.meter.own_settings()
    }

    fn set_own(
        &mut self,
        name: &str,
        value: &str,
        deadline: &Deadline,
    ) -> Result<super::Value, DeviceError> {
        self.meter.set_own(name, value, deadline)
    }
}

impl<M: PowerMeter> PowerMeter for Confirmed<M> {
    /// The second of the first two readings in a row that agree.
    fn power(&mut self, deadline: &Deadline) -> Result<Power, DeviceError> {
        let mut last = self.meter.power(deadline)?;
        for _ in 1..self.most {
            let next = self.meter.power(deadline)?;
            if self.agree(&last, &next) {
                return Ok(next);
            }
            last = next;
        }
        Err(DeviceError::Protocol {
            device: "power meter",
            reason: format!(
                "of {} readings no two in a row agree within {:e}: unsteady light, or a bad line",
                self.most, self.relative
            ),
        })
    }

    fn set_wavelength_nm(&mut self, nm: f64, deadline: &Deadline) -> Result<f64, DeviceError> {
        self.meter.set_wavelength_nm(nm, deadline)
    }

    fn ranges(&mut self, deadline: &Deadline) -> Result<Vec<String>, DeviceError> {
        self.meter.ranges(deadline)
    }

    fn set_range(&mut self, range: &str, deadline: &Deadline) -> Result<String, DeviceError> {
        self.meter.set_range(range, deadline)
    }

    fn zero(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.meter.zero(deadline)
    }
}
