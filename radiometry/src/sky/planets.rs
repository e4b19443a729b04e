//! The planets that the eye sees, Mercury to Saturn: where they stand and how bright they are.
//!
//! Their heliocentric places are those of `plan94` (Simon et al. 1994, A&A 282, 663, as SOFA has them). By SOFA's notes they are off by at most 4″ (Mercury), 5″ (Venus), 17″ (Mars),
//! 71″ (Jupiter) and 81″ (Saturn) of heliocentric longitude between 1800 and 2100. Good for the eye and for a map of the sky, not for pointing a narrow field.

use super::angles::{Horizontal, separation_rad};
use super::frame::{Observer, SkyFrame};
use crate::constants::{AU_M, LIGHT_M_PER_S};
use glam::DVec3;
use sofars::consts::DAYSEC;

/// A planet that the eye sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Planet {
    /// Mercury.
    Mercury,
    /// Venus.
    Venus,
    /// Mars.
    Mars,
    /// Jupiter.
    Jupiter,
    /// Saturn with its rings.
    Saturn,
}

impl Planet {
    /// All of them, from the Sun outwards.
    pub const ALL: [Self; 5] =
        [Self::Mercury, Self::Venus, Self::Mars, Self::Jupiter, Self::Saturn];

    /// Name of the planet.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mercury => "Mercury",
            Self::Venus => "Venus",
            Self::Mars => "Mars",
            Self::Jupiter => "Jupiter",
            Self::Saturn => "Saturn",
        }
    }

    /// Number of the planet in `plan94`, where 3 is the Earth with the Moon.
    fn number(self) -> i32 {
        match self {
            Self::Mercury => 1,
            Self::Venus => 2,
            Self::Mars => 4,
            Self::Jupiter => 5,
            Self::Saturn => 6,
        }
    }
}

/// A planet as an observer near the Earth sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanetPlace {
    /// The apparent direction, GCRS axes, unit vector: light time and aberration are in it.
    pub direction_gcrs: DVec3,
    /// The distance from the observer to where the planet was when the light left it, m.
    pub distance_m: f64,
    /// The distance of the planet from the Sun at that time, m.
    pub from_sun_m: f64,
    /// The phase angle Sun–planet–observer, degrees.
    pub phase_angle_deg: f64,
    /// V magnitude above the air (Mallama and Hilton 2018, Astronomy and Computing 25, 10); `None` at phase angles at which nobody measured the planet. Which side Mars shows and its
    /// seasons are left out: 0.06 mag each.
    pub v_mag: Option<f64>,
}

/// A planet from a site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanetSighting {
    /// The planet.
    pub planet: Planet,
    /// Direction at the site, true (unrefracted).
    pub horizontal: Horizontal,
    /// Direction, distance and brightness.
    pub place: PlanetPlace,
}

impl SkyFrame {
    /// A planet from the Earth's centre, as it is seen from there.
    pub fn planet(&self, planet: Planet) -> PlanetPlace {
        self.planet_seen_from(planet, DVec3::ZERO, DVec3::ZERO)
    }

    /// A planet's place about the Sun some seconds ago, m, axes of the GCRS (those of J2000.0, 0.02″ beside).
    fn planet_from_sun_m(&self, planet: Planet, ago_s: f64) -> DVec3 {
        // TDB is within 2 ms of TT.
        let tt = self.times().tt;
        let found = sofars::eph::plan94(tt.midnight, tt.fraction - ago_s / DAYSEC, planet.number());
        // It refuses numbers of planets that there are not.
        let [position_au, _] = found.map_or([[f64::NAN; 3]; 2], |(state, _)| state);
        DVec3::from_array(position_au) * AU_M
    }

    fn planet_seen_from(
        &self,
        planet: Planet,
        position_gcrs_m: DVec3,
        velocity_gcrs_m_s: DVec3,
    ) -> PlanetPlace {
        let sun_m = self.sun_position_gcrs_m() - position_gcrs_m;
        let sun_velocity_m_s =
            (self.earth_from_barycentre.velocity - self.earth_from_sun.velocity) * (AU_M / DAYSEC);
        // Three rounds: each gains a factor velocity/c, from hours of light time.
        let (mut ago_s, mut from_sun_m, mut line_m) = (0.0, DVec3::ZERO, DVec3::ZERO);
        for _ in 0..4 {
            from_sun_m = self.planet_from_sun_m(planet, ago_s);
            line_m = sun_m - sun_velocity_m_s * ago_s + from_sun_m;
            ago_s = line_m.length() / LIGHT_M_PER_S;
        }
        let distance_m = line_m.length();
        let velocity_c = (self.earth_velocity_m_s() + velocity_gcrs_m_s) / LIGHT_M_PER_S;
        let direction = sofars::astro::ab(
            &(line_m / distance_m).to_array(),
            &velocity_c.to_array(),
            sun_m.length() / AU_M,
            (1.0 - velocity_c.length_squared()).sqrt(),
        );
        PlanetPlace {
            direction_gcrs: DVec3::from_array(direction),
            distance_m,
            from_sun_m: from_sun_m.length(),
            phase_angle_deg: separation_rad(from_sun_m, line_m).to_degrees(),
            v_mag: magnitude(planet, from_sun_m, line_m),
        }
    }
}

impl Observer {
    /// A planet from the site: its parallax, light time, annual and diurnal aberration.
    pub fn planet(&self, planet: Planet) -> PlanetSighting {
        let (position, velocity) = (self.position_gcrs_m(), self.velocity_gcrs_m_s());
        let place = self.frame().planet_seen_from(planet, position, velocity);
        PlanetSighting { planet, horizontal: self.of_unit(place.direction_gcrs), place }
    }
}

/// Value of a polynomial, lowest power first.
fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// V magnitude of a planet (Mallama and Hilton 2018, equations 2 to 10), by its place from the Sun and from the observer, m.
fn magnitude(planet: Planet, from_sun_m: DVec3, line_m: DVec3) -> Option<f64> {
    let phase_deg = separation_rad(from_sun_m, line_m).to_degrees();
    let distances = 5.0 * (from_sun_m.length() / AU_M * line_m.length() / AU_M).log10();
    let reduced = match planet {
        Planet::Mercury if (2.0..170.0).contains(&phase_deg) => polynomial(
            &[-0.613, 6.3280e-2, -1.6336e-3, 3.3644e-5, -3.4265e-7, 1.6893e-9, -3.0334e-12],
            phase_deg,
        ),
        Planet::Venus if (2.0..163.7).contains(&phase_deg) => {
            polynomial(&[-4.384, -1.044e-3, 3.687e-4, -2.814e-6, 8.938e-9], phase_deg)
        }
        Planet::Venus if (163.7..179.0).contains(&phase_deg) => {
            polynomial(&[236.05828, -2.81914, 8.39034e-3], phase_deg)
        }
        Planet::Mars if phase_deg <= 50.0 => polynomial(&[-1.601, 2.267e-2, -1.302e-4], phase_deg),
        Planet::Jupiter if phase_deg <= 12.0 => polynomial(&[-9.395, -3.7e-4, 6.16e-4], phase_deg),
        Planet::Saturn if phase_deg <= 6.5 => {
            let latitude_deg = rings_deg(from_sun_m, line_m);
            if latitude_deg > 27.0 {
                return None;
            }
            let tilt = latitude_deg.to_radians().sin();
            -8.914 - 1.825 * tilt + 0.026 * phase_deg - 0.378 * tilt * (-2.25 * phase_deg).exp()
        }
        _ => return None,
    };
    Some(reduced + distances)
}

/// Opening of Saturn's rings, degrees: the geometric mean of the Sun's and the observer's latitudes on Saturn, 0 where they look at different sides.
fn rings_deg(from_sun_m: DVec3, line_m: DVec3) -> f64 {
    // Pole of Saturn at J2000.0 (IAU working group on cartographic coordinates 2015): right ascension 40.589°, declination 83.537°; it moves by 0.04° in a century.
    let (sin, cos) = 83.537_f64.to_radians().sin_cos();
    let (east, north) = 40.589_f64.to_radians().sin_cos();
    let pole = DVec3::new(cos * north, cos * east, sin);
    let latitude = |line: DVec3| separation_rad(pole, line).to_degrees() - 90.0;
    (latitude(from_sun_m) * latitude(line_m)).max(0.0).sqrt()
}
