//! Devices of a detector's rig, from their addresses.

use crate::brdf::rig::{OPEN, device};
use anyhow::{Context as _, bail};
use sunglint_detectors::efficiency::{CounterPlan, Unit};
use sunglint_detectors::reading::Pace;
use sunglint_drivers::catalogue::AnyDevice;
use sunglint_drivers::device::{
    FilterWheel, InBeam, Meter, Monochromator, PhotonCounter, PowerMeter, Source,
};
use sunglint_materials::retro::measure::{Hands, HandsError};
use sunglint_virtual::counting::devices::VirtualCounting;

/// Opens the device of an address; `key` names it in errors.
fn any(key: &str, address: &str, with: &[String], pace: &Pace) -> anyhow::Result<AnyDevice> {
    let found = device(address, with, &|| pace.within(OPEN.as_secs_f64()));
    found.with_context(|| format!("{key} = \"{address}\""))
}

pub(super) fn monochromator(
    address: &str,
    with: &[String],
    pace: &Pace,
) -> anyhow::Result<Box<dyn Monochromator>> {
    let key = "monochromator.device";
    match any(key, address, with, pace)? {
        AnyDevice::Monochromator(found) => Ok(found),
        _ => bail!("{key}: {address} is no monochromator"),
    }
}

/// A photodiode's meter of one of both kinds.
pub(super) enum AnyMeter {
    Meter(Box<dyn Meter>),
    Power(Box<dyn PowerMeter>),
}

pub(super) fn meter(
    address: &str,
    with: &[String],
    unit: Unit,
    pace: &Pace,
) -> anyhow::Result<AnyMeter> {
    let key = "meter.device";
    let found = match any(key, address, with, pace)? {
        AnyDevice::Meter(meter) => AnyMeter::Meter(meter),
        AnyDevice::PowerMeter(meter) => AnyMeter::Power(meter),
        _ => bail!("{key}: {address} is neither a meter nor a power meter"),
    };
    let has = match &found {
        AnyMeter::Meter(meter) => meter.unit().to_owned(),
        AnyMeter::Power(_) => Unit::W.name().to_owned(),
    };
    if has != unit.name() {
        bail!(
            "meter.unit = \"{}\", but {address} reads {has}: say unit = \"{has}\", or name another meter",
            unit.name()
        );
    }
    Ok(found)
}

pub(super) fn counter(plan: &CounterPlan, pace: &Pace) -> anyhow::Result<Box<dyn PhotonCounter>> {
    let key = "counter.device";
    match any(key, &plan.device, &plan.with, pace)? {
        AnyDevice::PhotonCounter(found) => Ok(found),
        _ => bail!("{key}: {} is no photon counter", plan.device),
    }
}

pub(super) fn wheel(
    address: &str,
    with: &[String],
    pace: &Pace,
) -> anyhow::Result<Box<dyn FilterWheel>> {
    let key = "wheel.device";
    match any(key, address, with, pace)? {
        AnyDevice::FilterWheel(found) => Ok(found),
        _ => bail!("{key}: {address} is no filter wheel"),
    }
}

pub(super) fn source(
    address: &str,
    with: &[String],
    pace: &Pace,
) -> anyhow::Result<Box<dyn Source>> {
    let key = "source.device";
    match any(key, address, with, pace)? {
        AnyDevice::Source(found) => Ok(found),
        _ => bail!("{key}: {address} is no source"),
    }
}

/// The virtual rig's hands.
pub(super) struct Robot(pub VirtualCounting);

impl Hands for Robot {
    fn put(&mut self, place: InBeam) -> Result<(), HandsError> {
        self.0.place(place);
        Ok(())
    }
}

/// What a person is asked for.
pub(super) fn words(place: InBeam) -> &'static str {
    match place {
        InBeam::Blocked => "close the shutter: no light on photodiode and detector",
        _ => "open the shutter",
    }
}
