//! Limits that keep a mount safe: arguments that all commands have which move one, and how they open it.

use crate::output::{Console, Usage};
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use hifitime::Epoch;
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{Mount, MountAbilities, MountAxes, MountKnown, MountSite};
use sunglint_observatory::telescope::{Guard, SunCone};
use sunglint_radiometry::station::Station;
use sunglint_rehearsal::track::MOUNTS;

/// How long a mount may take to be opened.
pub(crate) const OPEN: Duration = Duration::from_secs(30);

/// Axes of a mount, as a person names them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum AxesArg {
    /// Hour angle and declination.
    Equatorial,
    /// Azimuth and altitude.
    Altaz,
}

/// Limits that keep a mount safe, and facts about it that its driver does not tell.
#[derive(Debug, Args)]
pub struct MountArgs {
    /// Lowest altitude, degrees; the station's horizon may ask for more [default: 10; of `pointing` 20]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub min_elevation: Option<f64>,
    /// Least distance from the Sun while it is up, degrees; 5° are added for the mount's pointing
    #[arg(long, value_name = "DEG", default_value_t = 30.0)]
    pub sun_limit: f64,
    /// The mount is a fork: it never turns over at the meridian, also where its driver tells a side of a pier
    #[arg(long)]
    pub fork: bool,
    /// Axes about which the mount turns [default: those that its driver tells; where it tells none, the ways of both kinds are kept off the Sun]
    #[arg(long, value_name = "AXES")]
    pub axes: Option<AxesArg>,
    /// Fastest rate that its motors do, degrees a second, where its driver publishes more
    #[arg(long, value_name = "DEG_S")]
    pub most_rate_deg_s: Option<f64>,
    /// Slowest rate other than none that it takes, arcsec a second: slower ones are sent as the nearer of the two (EQMOD: 0.76)
    #[arg(long, value_name = "ARCSEC_S")]
    pub least_rate_arcsec_s: Option<f64>,
    /// The mount's own software lifts places by refraction: leave that to it
    #[arg(long)]
    pub no_refraction: bool,
    /// You know that this computer's clock is right, though nothing says so
    #[arg(long)]
    pub trust_clock: bool,
    /// Tell the mount the station's site, and UTC, first
    #[arg(long)]
    pub set_site: bool,
}

impl MountArgs {
    /// Refuses numbers that no mount has. `lowest_deg` is the command's lowest altitude where none is given, deg.
    pub(crate) fn check(&self, lowest_deg: f64) -> Result<(), Usage> {
        let within = |name: &str, value: f64, least: f64, most: f64| match value {
            v if (least..=most).contains(&v) => Ok(()),
            v => Err(Usage(format!("--{name} is {v}, expected {least} to {most}"))),
        };
        within("min-elevation", self.lowest_deg(lowest_deg), 0.0, 89.0)?;
        within("sun-limit", self.sun_limit, 10.0, 90.0)?;
        self.known().map(|_| ())
    }

    /// Lowest altitude, deg; `usual` where none is given.
    pub(crate) fn lowest_deg(&self, usual: f64) -> f64 {
        self.min_elevation.unwrap_or(usual)
    }

    pub(crate) fn known(&self) -> Result<MountKnown, Usage> {
        let within = |name: &str, value: Option<f64>, least: f64, most: f64| match value {
            Some(v) if !(least..=most).contains(&v) => {
                Err(Usage(format!("--{name} is {v}, expected {least} to {most}")))
            }
            other => Ok(other),
        };
        Ok(MountKnown {
            axes: self.axes.map(|axes| match axes {
                AxesArg::Equatorial => MountAxes::Equatorial,
                AxesArg::Altaz => MountAxes::Horizontal,
            }),
            german: self.fork.then_some(false),
            most_deg_s: within("most-rate-deg-s", self.most_rate_deg_s, 0.01, 100.0)?,
            least_deg_s: within("least-rate-arcsec-s", self.least_rate_arcsec_s, 0.0, 60.0)?
                .map(|rate| rate / 3600.0),
        })
    }

    /// Opens a mount that knows what is known of it.
    pub(crate) fn open(&self, address: &str) -> anyhow::Result<Box<dyn Mount>> {
        let mut mount = open(address)?;
        mount.know(&self.known()?);
        Ok(mount)
    }

    /// Limits that keep a mount of a station off the Sun and the ground.
    pub(crate) fn guard(
        &self,
        lowest_deg: f64,
        station: &Station,
        abilities: &MountAbilities,
    ) -> Guard {
        let cone = SunCone::default().with_limit_deg(self.sun_limit);
        Guard::of(&station.site, abilities, cone)
            .with_horizon(station.horizon.clone(), self.lowest_deg(lowest_deg))
    }

    /// Tells the mount site and UTC, where that is wanted.
    pub(crate) fn tell_site(&self, mount: &mut dyn Mount, station: &Station) -> anyhow::Result<()> {
        if !self.set_site {
            return Ok(());
        }
        let place = station.site.geodetic();
        let site = MountSite {
            latitude_deg: place.latitude_deg,
            longitude_deg: place.longitude_deg,
            height_m: place.height_m,
        };
        let now = Epoch::now().context("the system has no clock")?;
        Ok(mount.set_site(site, now, &Deadline::within(Duration::from_secs(5)))?)
    }

    /// Whether places are lifted by refraction for a mount; where its own software does it, that is said.
    pub(crate) fn refracts(&self, mount: &dyn Mount, console: Console) -> bool {
        let own = mount.abilities().refracts == Some(true);
        if own && !self.no_refraction {
            console.say("the mount's own software lifts places by refraction: that is left to it");
        }
        !self.no_refraction && !own
    }
}

/// Opens a mount.
pub(crate) fn open(address: &str) -> anyhow::Result<Box<dyn Mount>> {
    let mut address = Address::parse(address, &[]).map_err(|error| {
        anyhow!(
            "--mount: {error}; or {} for a rehearsal",
            MOUNTS.map(|mount| mount.name).join(", ")
        )
    })?;
    let deadline = Deadline::within(OPEN);
    let line = address.connect(&deadline)?;
    match address.open(line, &deadline)? {
        AnyDevice::Mount(mount) => Ok(mount),
        other => bail!("--mount: this is a {}, no mount", other.kind()),
    }
}
