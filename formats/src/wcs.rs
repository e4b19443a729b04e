//! World coordinates of a frame: pixels to right ascension and declination, and back.
//!
//! Zenithal projections (`TAN`, `SIN`, `ARC`, `STG`) with the distortions of SIP and TPV, as astrometry.net, ASTAP, PlateSolve, SCAMP and the programs that call them write
//! them. Sources: Greisen & Calabretta 2002 (A&A 395, 1061) for the linear part, Calabretta & Greisen 2002 (A&A 395, 1077) for the projections, Shupe et al. 2005 (ADASS XIV,
//! 491) for SIP, the FITS registry's document of TPV.
//!
//! Places in pixels count from 0 at the middle of the first pixel; the cards count from 1.

use crate::fits::Header;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Polynomials of TPV stop here: the terms of third order.
const TPV_TERMS: usize = 11;
/// Orders of SIP that are read at most.
const MOST_SIP: usize = 9;

/// Right ascension and declination, in the frame that the context names. Written as a pair.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(into = "[f64; 2]", from = "[f64; 2]")]
pub struct Equatorial {
    /// Right ascension, degrees; in [0, 360) where it is a result.
    pub ra_deg: f64,
    /// Declination, degrees.
    pub dec_deg: f64,
}

impl Equatorial {
    /// The unit vector.
    pub fn direction(self) -> DVec3 {
        let (sin_ra, cos_ra) = self.ra_deg.to_radians().sin_cos();
        let (sin_dec, cos_dec) = self.dec_deg.to_radians().sin_cos();
        DVec3::new(cos_dec * cos_ra, cos_dec * sin_ra, sin_dec)
    }

    /// Converts a vector of any length; right ascension is 0 at the poles.
    pub fn of_direction(direction: DVec3) -> Self {
        let DVec3 { x, y, z } = direction;
        Self { ra_deg: circle_deg(y.atan2(x)), dec_deg: z.atan2(x.hypot(y)).to_degrees() }
    }

    /// Whether both are finite.
    pub fn is_finite(self) -> bool {
        self.ra_deg.is_finite() && self.dec_deg.is_finite()
    }

    /// Right ascension and declination, degrees.
    pub const fn to_array(self) -> [f64; 2] {
        [self.ra_deg, self.dec_deg]
    }
}

impl From<[f64; 2]> for Equatorial {
    /// Takes the right ascension first.
    fn from([ra_deg, dec_deg]: [f64; 2]) -> Self {
        Self { ra_deg, dec_deg }
    }
}

impl From<Equatorial> for [f64; 2] {
    fn from(place: Equatorial) -> Self {
        place.to_array()
    }
}

/// Radians to degrees in [0, 360).
pub fn circle_deg(angle_rad: f64) -> f64 {
    let degrees = angle_rad.to_degrees().rem_euclid(360.0);
    // A tiny negative angle rounds up to 360 itself.
    if degrees < 360.0 { degrees } else { 0.0 }
}

/// Relation of distance from the pole and native latitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Projection {
    Tan,
    Sin,
    Arc,
    Stg,
}

/// Powers of u and v, and their coefficient.
type Term = (i32, i32, f64);

/// Displacement of pixels or of intermediate coordinates.
#[derive(Debug, Clone, PartialEq)]
enum Distortion {
    None,
    /// Coefficients of u^p v^q of both axes, px.
    Sip([Vec<Term>; 2]),
    /// Coefficients of both axes, deg.
    Tpv(Box<[[f64; TPV_TERMS]; 2]>),
}

/// Returns true for a keyword of celestial world coordinates of a header, its distortions included.
pub fn is_coordinate(keyword: &str) -> bool {
    const PLAIN: [&str; 6] = ["WCSAXES", "RADESYS", "EQUINOX", "LONPOLE", "LATPOLE", "EPOCH"];
    const INDEXED: [&str; 7] = ["CTYPE", "CUNIT", "CRVAL", "CRPIX", "CDELT", "CROTA", "CNAME"];
    const MATRICES: [&str; 3] = ["CD", "PC", "PV"];
    const SIP: [&str; 4] = ["A_", "B_", "AP_", "BP_"];
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let pair = |text: &str| text.split_once('_').is_some_and(|(a, b)| digits(a) && digits(b));
    PLAIN.contains(&keyword)
        || INDEXED.iter().any(|k| keyword.strip_prefix(k).is_some_and(digits))
        || MATRICES.iter().any(|k| keyword.strip_prefix(k).is_some_and(pair))
        || SIP.iter().any(|k| {
            keyword
                .strip_prefix(k)
                .is_some_and(|rest| rest == "ORDER" || rest == "DMAX" || pair(rest))
        })
}

/// World coordinates of a frame, ICRS or FK5 of J2000 (they differ by 0.02″).
#[derive(Debug, Clone, PartialEq)]
pub struct Wcs {
    /// Right ascension and declination of the reference, deg.
    reference_deg: [f64; 2],
    /// The reference pixel, counted from 0.
    reference_px: [f64; 2],
    /// Intermediate coordinates (towards growing right ascension, declination) for a pixel, deg/px.
    matrix: [[f64; 2]; 2],
    inverse: [[f64; 2]; 2],
    projection: Projection,
    distortion: Distortion,
    /// Native longitude of the celestial pole, deg.
    pole_deg: f64,
}

impl Wcs {
    /// Makes the coordinates of a tangential projection without distortion: the reference in deg, its pixel counted from 0, and the change of
    /// the tangential coordinates (east, north) for a column and a row, deg/px. `None` for a matrix that cannot be inverted, or a number that is not finite.
    pub fn tangential(
        reference_deg: Equatorial,
        reference_px: DVec2,
        matrix: [[f64; 2]; 2],
    ) -> Option<Self> {
        let (reference_deg, reference_px) = (reference_deg.to_array(), reference_px.to_array());
        let inverse = inverted(matrix)?;
        let finite = reference_deg.iter().chain(&reference_px).all(|v| v.is_finite());
        finite.then_some(Self {
            reference_deg,
            reference_px,
            matrix,
            inverse,
            projection: Projection::Tan,
            distortion: Distortion::None,
            pole_deg: if reference_deg[1] >= 90.0 { 0.0 } else { 180.0 },
        })
    }

    /// The coordinates that a header tells; `None` where it tells none.
    ///
    /// # Errors
    /// In words, why coordinates that are there cannot be used: another projection, an equinox other than 2000, a card that is missing or no number.
    pub fn from_header(header: &Header) -> Result<Option<Self>, String> {
        let kind = |axis: usize| header.text(&format!("CTYPE{axis}")).map(str::trim);
        let (Some(first), Some(second)) = (kind(1), kind(2)) else { return Ok(None) };
        let is = |kind: &str, name: &str| kind.starts_with(name);
        let is_swapped = match (is(first, "RA--"), is(second, "DEC-")) {
            (true, true) => false,
            _ if is(first, "DEC-") && is(second, "RA--") => true,
            _ => return Ok(None),
        };
        let code = first.get(5..8).unwrap_or_default();
        if second.get(5..8) != Some(code) {
            return Err(format!("CTYPE1 {first} and CTYPE2 {second} do not belong together"));
        }
        let projection = match code {
            "TAN" | "TPV" => Projection::Tan,
            "SIN" => Projection::Sin,
            "ARC" => Projection::Arc,
            "STG" => Projection::Stg,
            _ => {
                return Err(format!(
                    "the projection {first} is not known (TAN, SIN, ARC, STG, TPV are)"
                ));
            }
        };
        check_equinox(header)?;
        let need = |keyword: String| {
            header
                .real(&keyword)
                .filter(|v| v.is_finite())
                .ok_or_else(|| format!("{keyword} is missing or no number"))
        };
        let mut reference_deg = [need("CRVAL1".into())?, need("CRVAL2".into())?];
        let reference_px = [need("CRPIX1".into())? - 1.0, need("CRPIX2".into())? - 1.0];
        let mut matrix = linear(header)?;
        if is_swapped {
            if header.real("CROTA1").or_else(|| header.real("CROTA2")).is_some_and(|v| v != 0.0) {
                return Err("CROTA with the declination first is not read".into());
            }
            reference_deg.swap(0, 1);
            matrix.swap(0, 1);
        }
        if reference_deg[1].abs() > 90.0 {
            return Err(format!("the declination {} is beyond 90°", reference_deg[1]));
        }
        let inverse = inverted(matrix).ok_or("the matrix of its pixels cannot be inverted")?;
        let given = header.real("LONPOLE").filter(|v| v.is_finite());
        let pole_deg = given.unwrap_or(if reference_deg[1] >= 90.0 { 0.0 } else { 180.0 });
        let distortion = if first.ends_with("-SIP") || header.integer("A_ORDER").is_some() {
            Distortion::Sip(sip(header)?)
        } else if code == "TPV" || code == "TAN" && header.real("PV1_1").is_some() {
            if is_swapped {
                return Err("TPV with the declination first is not read".into());
            }
            Distortion::Tpv(Box::new(tpv(header)?))
        } else {
            Distortion::None
        };
        Ok(Some(Self {
            reference_deg,
            reference_px,
            matrix,
            inverse,
            projection,
            distortion,
            pole_deg,
        }))
    }

    /// The cards of a tangential projection without distortion; `None` for any other.
    pub fn cards(&self) -> Option<Header> {
        if self.projection != Projection::Tan || self.distortion != Distortion::None {
            return None;
        }
        let mut header = Header::default();
        header.set("WCSAXES", 2_i64, "");
        header.set("RADESYS", "ICRS", "");
        header.set("CTYPE1", "RA---TAN", "");
        header.set("CTYPE2", "DEC--TAN", "");
        header.set("CUNIT1", "deg", "");
        header.set("CUNIT2", "deg", "");
        header.set("CRVAL1", self.reference_deg[0], "right ascension of the reference");
        header.set("CRVAL2", self.reference_deg[1], "declination of the reference");
        header.set("CRPIX1", self.reference_px[0] + 1.0, "the first pixel's middle is 1");
        header.set("CRPIX2", self.reference_px[1] + 1.0, "");
        for (i, row) in self.matrix.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                header.set(&format!("CD{}_{}", i + 1, j + 1), *value, "deg/px");
            }
        }
        header.set("LONPOLE", self.pole_deg, "");
        Some(header)
    }

    /// Right ascension (0 to 360) and declination of a place in pixels, deg; `None` where the projection has none.
    pub fn sky(&self, place_px: DVec2) -> Option<Equatorial> {
        let mut u = [0, 1].map(|k| place_px[k] - self.reference_px[k]);
        if let Distortion::Sip(terms) = &self.distortion {
            let shift = [0, 1].map(|k| polynomial(&terms[k], u));
            u = [u[0] + shift[0], u[1] + shift[1]];
        }
        let mut x = apply(self.matrix, u);
        if let Distortion::Tpv(terms) = &self.distortion {
            x = distorted(terms, x);
        }
        let radius = x[0].hypot(x[1]).to_radians();
        // Sine and cosine of the distance from the native pole.
        let (sin, cos) = match self.projection {
            Projection::Tan => radius.atan().sin_cos(),
            Projection::Sin => (radius <= 1.0).then(|| (radius, (1.0 - radius * radius).sqrt()))?,
            Projection::Arc => (radius < std::f64::consts::PI).then(|| radius.sin_cos())?,
            Projection::Stg => (2.0 * (0.5 * radius).atan()).sin_cos(),
        };
        let native = x[0].atan2(-x[1]) - self.pole_deg.to_radians();
        let (sin_n, cos_n) = native.sin_cos();
        let (sin_d, cos_d) = self.reference_deg[1].to_radians().sin_cos();
        let east = -sin * sin_n;
        let toward = cos * cos_d - sin * sin_d * cos_n;
        let north = cos * sin_d + sin * cos_d * cos_n;
        let ra = self.reference_deg[0] + east.atan2(toward).to_degrees();
        let sky = [ra.rem_euclid(360.0), north.atan2(east.hypot(toward)).to_degrees()];
        sky.iter().all(|v| v.is_finite()).then(|| sky.into())
    }

    /// Place in pixels of a right ascension and declination, deg; `None` where the projection has none, or its distortion cannot be undone there.
    pub fn pixel(&self, sky: Equatorial) -> Option<DVec2> {
        let (sin_a, cos_a) = (sky.ra_deg - self.reference_deg[0]).to_radians().sin_cos();
        let (sin_b, cos_b) = sky.dec_deg.to_radians().sin_cos();
        let (sin_d, cos_d) = self.reference_deg[1].to_radians().sin_cos();
        let east = -cos_b * sin_a;
        let north = sin_b * cos_d - cos_b * sin_d * cos_a;
        let cos = sin_b * sin_d + cos_b * cos_d * cos_a;
        let sin = east.hypot(north);
        let radius = match self.projection {
            Projection::Tan => (cos > 1e-6).then_some(sin / cos)?,
            Projection::Sin => (cos >= 0.0).then_some(sin)?,
            Projection::Arc => sin.atan2(cos),
            Projection::Stg => (cos > -0.9999).then_some(2.0 * sin / (1.0 + cos))?,
        };
        let (sin_n, cos_n) = (east.atan2(north) + self.pole_deg.to_radians()).sin_cos();
        let mut x = [radius * sin_n, -radius * cos_n].map(f64::to_degrees);
        if let Distortion::Tpv(terms) = &self.distortion {
            x = undone(x, |x| distorted(terms, x), 1e-12)?;
        }
        let mut u = apply(self.inverse, x);
        if let Distortion::Sip(terms) = &self.distortion {
            let forward = |u: [f64; 2]| {
                let shift = [0, 1].map(|k| polynomial(&terms[k], u));
                [u[0] + shift[0], u[1] + shift[1]]
            };
            u = undone(u, forward, 1e-7)?;
        }
        let place = [u[0] + self.reference_px[0], u[1] + self.reference_px[1]];
        place.iter().all(|v| v.is_finite()).then(|| place.into())
    }

    /// Width of a pixel at the reference, arcsec: the root of its area.
    pub fn scale_arcsec(&self) -> f64 {
        let [[a, b], [c, d]] = self.matrix;
        3600.0 * (a * d - b * c).abs().sqrt()
    }
}

/// Refuses coordinates of another equinox than 2000.
fn check_equinox(header: &Header) -> Result<(), String> {
    let system = ["RADESYS", "RADECSYS"].into_iter().find_map(|k| header.text(k)).map(str::trim);
    match system {
        Some(system) if system.starts_with("ICRS") => return Ok(()),
        Some(system) if !system.is_empty() && !system.starts_with("FK5") => {
            return Err(format!("its system is {system}, expected ICRS or FK5"));
        }
        _ => {}
    }
    match header.real("EQUINOX").or_else(|| header.real("EPOCH")) {
        Some(year) if (year - 2000.0).abs() > 0.1 => {
            Err(format!("its equinox is {year}, expected 2000"))
        }
        _ => Ok(()),
    }
}

/// The matrix of CD, of PC and CDELT, or of CDELT and CROTA2.
fn linear(header: &Header) -> Result<[[f64; 2]; 2], String> {
    let card = |name: &str, i: usize, j: usize| {
        [format!("{name}{i}_{j}"), format!("{name}{i:03}{j:03}")]
            .iter()
            .find_map(|keyword| header.real(keyword))
    };
    let all =
        |name: &str| [[card(name, 1, 1), card(name, 1, 2)], [card(name, 2, 1), card(name, 2, 2)]];
    let cd = all("CD");
    if cd.iter().flatten().any(Option::is_some) {
        return Ok(cd.map(|row| row.map(|v| v.unwrap_or(0.0))));
    }
    let step = [header.real("CDELT1"), header.real("CDELT2")];
    let [Some(x), Some(y)] = step else {
        return Err("neither CD1_1 nor CDELT1 and CDELT2 are there".into());
    };
    let pc = all("PC");
    if pc.iter().flatten().any(Option::is_some) {
        let of = |i: usize, j: usize| pc[i][j].unwrap_or(if i == j { 1.0 } else { 0.0 });
        return Ok([[x * of(0, 0), x * of(0, 1)], [y * of(1, 0), y * of(1, 1)]]);
    }
    let (sin, cos) = header.real("CROTA2").unwrap_or(0.0).to_radians().sin_cos();
    Ok([[x * cos, -y * sin], [x * sin, y * cos]])
}

/// The terms of SIP from pixels to the sky.
fn sip(header: &Header) -> Result<[Vec<Term>; 2], String> {
    let of = |name: char| -> Result<Vec<Term>, String> {
        let order = header.integer(&format!("{name}_ORDER")).unwrap_or(0);
        let order = usize::try_from(order).ok().filter(|n| *n <= MOST_SIP);
        let order = order.ok_or_else(|| format!("{name}_ORDER is not 0 to {MOST_SIP}"))?;
        let mut terms = Vec::new();
        for p in 0..=order {
            for q in 0..=order - p {
                let value = header.real(&format!("{name}_{p}_{q}"));
                if let Some(value) = value.filter(|v| *v != 0.0) {
                    terms.push((p as i32, q as i32, value));
                }
            }
        }
        Ok(terms)
    };
    Ok([of('A')?, of('B')?])
}

/// The terms of TPV; those of right ascension first.
fn tpv(header: &Header) -> Result<[[f64; TPV_TERMS]; 2], String> {
    let mut terms = [[0.0; TPV_TERMS]; 2];
    for (axis, terms) in terms.iter_mut().enumerate() {
        let number = axis + 1;
        for (k, term) in terms.iter_mut().enumerate() {
            let missing = if k == 1 { 1.0 } else { 0.0 };
            *term = header.real(&format!("PV{number}_{k}")).unwrap_or(missing);
        }
        for k in TPV_TERMS..40 {
            if header.real(&format!("PV{number}_{k}")).is_some_and(|v| v != 0.0) {
                return Err(format!("PV{number}_{k} is there; TPV is read to third order"));
            }
        }
    }
    Ok(terms)
}

fn polynomial(terms: &[Term], u: [f64; 2]) -> f64 {
    terms.iter().map(|(p, q, value)| value * u[0].powi(*p) * u[1].powi(*q)).sum()
}

fn distorted(terms: &[[f64; TPV_TERMS]; 2], x: [f64; 2]) -> [f64; 2] {
    let of = |c: &[f64; TPV_TERMS], x: f64, y: f64| {
        let r = x.hypot(y);
        let powers =
            [1.0, x, y, r, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y];
        c.iter().zip(powers).map(|(c, p)| c * p).sum::<f64>()
    };
    [of(&terms[0], x[0], x[1]), of(&terms[1], x[1], x[0])]
}

/// The argument for which `forward` gives the value: corrected by what is missing until nothing is.
fn undone(value: [f64; 2], forward: impl Fn([f64; 2]) -> [f64; 2], small: f64) -> Option<[f64; 2]> {
    let mut at = value;
    for _ in 0..100 {
        let got = forward(at);
        let missing = [value[0] - got[0], value[1] - got[1]];
        at = [at[0] + missing[0], at[1] + missing[1]];
        if missing[0].abs().max(missing[1].abs()) < small {
            return Some(at);
        }
    }
    None
}

fn apply(m: [[f64; 2]; 2], u: [f64; 2]) -> [f64; 2] {
    [m[0][0] * u[0] + m[0][1] * u[1], m[1][0] * u[0] + m[1][1] * u[1]]
}

fn inverted([[a, b], [c, d]]: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
    let determinant = a * d - b * c;
    let good = determinant.is_finite() && determinant.abs() > 1e-30;
    good.then(|| [[d / determinant, -b / determinant], [-c / determinant, a / determinant]])
}
