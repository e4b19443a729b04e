//! Corner cubes: what of a laser's light they send back towards where it came from, and how far beside that.
//!
//! A ray that enters a cube through its round front leaves it, after one reflection on each of three faces, antiparallel. The order of the faces is one of six, and each order is a wedge of the
//! aperture about the image of the vertex. Within a wedge the field has one Jones matrix (the front's transmissions, three reflections) and, where the dihedral angles are not quite 90°, one tilt.
//! The far field towards a direction w is therefore a sum of six integrals,
//!
//! ```text
//! σ = (4π/λ²) · ½ Σ_in Σ_out |Σ_wedge J ∬ exp(ik (δ_wedge − ϑ)·x) dA|²
//! ```
//!
//! with δ the tilt of the wedge's beam and ϑ the direction of the receiver, both from the antiparallel direction; the mean is over both polarisations of the laser, the sum over both that a receiver takes. The radial part of each
//! integral is a closed form, the azimuthal one a Gauss–Legendre sum (Degnan, *Millimeter accuracy satellite laser ranging*, 1993; Arnold, *Cross section of ILRS satellites*, 2003).
//!
//! A receiver never stands at ϑ = 0: while light is on its way the satellite moves on, and the beam that comes back is displaced by 2v/c ([`velocity_aberration`]).

mod complex;
mod file;

pub use file::RetroFile;

use complex::{Complex, real};
use glam::{DQuat, DVec3};
use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};
use sunglint_numerics::gauss;
use sunglint_radiometry::constants::LIGHT_M_PER_S;

/// Glass that a cube is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Glass {
    /// Fused silica (Malitson, J. Opt. Soc. Am. 55, 1205, 1965).
    FusedSilica,
    /// Three mirrors without glass between them.
    Hollow,
    /// A refractive index of its own.
    Index(f64),
}

impl Glass {
    /// The refractive index at a vacuum wavelength, nm.
    pub fn index(self, nm: f64) -> f64 {
        match self {
            Self::Hollow => 1.0,
            Self::Index(n) => n,
            Self::FusedSilica => {
                let square = (nm * 1e-3).powi(2);
                let terms = [
                    (0.696_166_3, 0.068_404_3_f64),
                    (0.407_942_6, 0.116_241_4),
                    (0.897_479_4, 9.896_161),
                ];
                let sum: f64 = terms.iter().map(|(b, l)| b * square / (square - l * l)).sum();
                (1.0 + sum).sqrt()
            }
        }
    }
}

/// Back faces of a cube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Back {
    /// Bare glass: total reflection, with phases that depend on the polarisation, up to a critical angle.
    Uncoated,
    /// A metal of a complex refractive index n + ik.
    Metal {
        /// n.
        n: f64,
        /// k.
        k: f64,
    },
    /// A mirror without loss.
    Perfect,
}

/// A corner cube with a round front.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerCube {
    /// Middle of its front, body axes, m.
    pub position_m: DVec3,
    /// Outward normal of its front, unit, body axes.
    pub normal: DVec3,
    /// Direction near which the projection of one edge lies, unit, perpendicular to the normal: how the cube is turned in its mount.
    pub edge: DVec3,
    /// Diameter of the front, m.
    pub diameter_m: f64,
    /// Glass.
    pub glass: Glass,
    /// Back faces.
    pub back: Back,
    /// Excess of the three dihedral angles over 90°, radians.
    pub dihedral_rad: f64,
}

/// Shift of a returned beam in the direction of a receiver beside the laser, radians: the direction of the receiver from the middle of the beam, 2v/c of the satellite's velocity across the line of sight,
/// backwards. `velocity_m_s` is the satellite's against the station (GCRS velocities serve to 8 %: the ground's own motion is left out), `toward` the unit vector from the satellite to the station, in the same axes.
pub fn velocity_aberration(velocity_m_s: DVec3, toward: DVec3) -> DVec3 {
    let across = velocity_m_s - velocity_m_s.dot(toward) * toward;
    -2.0 / LIGHT_M_PER_S * across
}

/// Nodes of the azimuthal integral in each piece of a wedge.
const ORDER: usize = 12;

impl CornerCube {
    /// Depth of the vertex below the front, m.
    pub fn vertex_depth_m(&self) -> f64 {
        self.diameter_m * FRAC_1_SQRT_2
    }

    /// The cross-section of a perfect mirror of the same front on its axis, 4πA²/λ², m².
    pub fn ideal_m2(&self, nm: f64) -> f64 {
        let area = 0.25 * PI * self.diameter_m.powi(2);
        4.0 * PI * (area / (nm * 1e-9)).powi(2)
    }

    /// Depth of its returns, m: half of the optical way from the plane through the body's origin across `toward` and back. A solid cube adds L√(n² − sin²θ) of its vertex depth L to its front's middle.
    pub fn depth_m(&self, nm: f64, toward: DVec3) -> f64 {
        let n = self.glass.index(nm);
        let cosine = self.normal.dot(toward).clamp(-1.0, 1.0);
        let glass = self.vertex_depth_m() * (n * n - (1.0 - cosine * cosine)).max(0.0).sqrt();
        glass - self.position_m.dot(toward)
    }

    /// The axes of the front: one edge's projection, the third, the normal.
    fn frame(&self) -> [DVec3; 3] {
        let z = self.normal;
        let x = (self.edge - self.edge.dot(z) * z)
            .try_normalize()
            .unwrap_or_else(|| z.any_orthonormal_vector());
        [x, z.cross(x), z]
    }

    /// Optical cross-section towards a receiver, m²: mean over the laser's polarisations, both taken. `toward` is the unit vector to the laser, `offset_rad` the receiver's direction less that
    /// ([`velocity_aberration`]; the part along `toward` does not count). 0 beyond the acceptance angle.
    pub fn cross_section_m2(&self, nm: f64, toward: DVec3, offset_rad: DVec3) -> f64 {
        let Some(light) = self.light(nm, toward) else { return 0.0 };
        let k = TAU / (nm * 1e-9);
        let offset = self.frame().map(|axis| offset_rad.dot(axis));
        let mut fields = [[Complex::default(); 2]; 2];
        for wedge in &light.wedges {
            let slope = [0, 1].map(|i| k * (wedge.tilt[i] - offset[i]));
            let integral = wedge.integral(&light.disc, slope);
            for (row, jones) in fields.iter_mut().zip(wedge.jones) {
                for (field, j) in row.iter_mut().zip(jones) {
                    *field = *field + j * integral;
                }
            }
        }
        let power: f64 = fields.iter().flatten().map(|f| f.norm_sqr()).sum();
        0.5 * power * light.cosine.powi(2) * 4.0 * PI / (nm * 1e-9).powi(2)
    }

    /// Active area across the line of sight, m²: rays that are returned; 0 beyond the acceptance angle.
    pub fn active_area_m2(&self, nm: f64, toward: DVec3) -> f64 {
        let Some(light) = self.light(nm, toward) else { return 0.0 };
        let area: f64 = light.wedges.iter().map(|w| w.integral(&light.disc, [0.0; 2]).re).sum();
        area * light.cosine
    }

    /// Power of what is returned over what falls on its front's projected area, mean over polarisations.
    pub fn throughput(&self, nm: f64, toward: DVec3) -> f64 {
        let Some(light) = self.light(nm, toward) else { return 0.0 };
        let one = |w: &Wedge| {
            let gain: f64 = w.jones.iter().flatten().map(|j| 0.5 * j.norm_sqr()).sum();
            gain * w.integral(&light.disc, [0.0; 2]).re
        };
        light.wedges.iter().map(one).sum::<f64>() / (0.25 * PI * self.diameter_m.powi(2))
    }

    /// The directions of the beams that the six wedges send, from the antiparallel one, radians, body axes.
    pub fn beams(&self, nm: f64, toward: DVec3) -> Vec<DVec3> {
        let [x, y, _] = self.frame();
        let light = self.light(nm, toward);
        light.iter().flat_map(|l| &l.wedges).map(|w| w.tilt[0] * x + w.tilt[1] * y).collect()
    }

    /// The six wedges for light from a direction; `None` where no ray meets all three faces.
    fn light(&self, nm: f64, toward: DVec3) -> Option<Light> {
        let frame = self.frame();
        let u = DVec3::from_array(frame.map(|axis| toward.dot(axis)));
        let n = self.glass.index(nm);
        if u.z <= 0.0 {
            return None;
        }
        // Within the glass.
        let d = refracted(-u, n);
        let edges = edges();
        if edges.iter().any(|e| d.dot(*e) >= -1e-9) {
            return None;
        }
        // The image of the vertex on the front, and twice it: by so much is the exit's disc displaced.
        let depth = self.vertex_depth_m();
        let image = [d.x / d.z * depth, d.y / d.z * depth];
        let radius = 0.5 * self.diameter_m;
        let apart = image[0].hypot(image[1]);
        if apart >= radius {
            return None;
        }
        let disc = Disc { radius, apart, toward: image[1].atan2(image[0]) };
        let mut orders = Vec::with_capacity(6);
        for first in 0..3 {
            for second in (0..3).filter(|k| *k != first) {
                orders.push([first, second, 3 - first - second]);
            }
        }
        let faces = leaning(self.dihedral_rad);
        let wedges = orders.iter().map(|order| {
            let jones = self.jones(n, u, d, order);
            let mut out = d;
            for k in order {
                out -= 2.0 * out.dot(faces[*k]) * faces[*k];
            }
            // The tangential parts are n times those within; against those of the antiparallel beam.
            let tilt = [n * out.x - u.x, n * out.y - u.y];
            Wedge { edges: sector(&edges, d, order), jones, tilt }
        });
        Some(Light { wedges: wedges.collect(), disc, cosine: u.z })
    }

    /// The Jones matrix of an order of faces: amplitudes out (rows) of amplitudes in, each along s and p of the front.
    fn jones(&self, n: f64, u: DVec3, d: DVec3, order: &[usize; 3]) -> [[Complex; 2]; 2] {
        // Way in and way out together: t t' = 1 − r² of each polarisation, the same glass on both ways.
        let (cos_out, cos_in) = (u.z, -d.z);
        let fresnel_s = (cos_out - n * cos_in) / (cos_out + n * cos_in);
        let fresnel_p = (n * cos_out - cos_in) / (n * cos_out + cos_in);
        let pass = [(1.0 - fresnel_s * fresnel_s).sqrt(), (1.0 - fresnel_p * fresnel_p).sqrt()];
        let (inside, leaving) = (basis(d), basis(-d));
        let mut columns = [[Complex::default(); 2]; 2];
        for (column, pass_in) in pass.iter().enumerate() {
            // The field within the glass, on the axes of space.
            let start = [inside.0, inside.1][column] * *pass_in;
            let mut field = start.to_array().map(real);
            let mut way = d;
            for k in order {
                (field, way) = self.reflected(field, way, edges()[*k], n);
            }
            let along = |axis: DVec3| {
                axis.to_array()
                    .iter()
                    .zip(field)
                    .fold(Complex::default(), |sum, (a, f)| sum + f * *a)
            };
            columns[column] = [along(leaving.0) * pass[0], along(leaving.1) * pass[1]];
        }
        // s and p within the glass continue those without: the plane of incidence is one.
        [[columns[0][0], columns[1][0]], [columns[0][1], columns[1][1]]]
    }

    /// A field after a reflection on a face with an inward normal, and its new direction.
    fn reflected(
        &self,
        field: [Complex; 3],
        way: DVec3,
        face: DVec3,
        n: f64,
    ) -> ([Complex; 3], DVec3) {
        let cosine = -way.dot(face);
        let out = way + 2.0 * cosine * face;
        let s = way.cross(face).try_normalize().unwrap_or_else(|| face.any_orthonormal_vector());
        let (p_in, p_out) = (s.cross(way), s.cross(out));
        let (rs, rp) = self.fresnel(cosine, n);
        let along = |axis: DVec3| {
            axis.to_array().iter().zip(field).fold(Complex::default(), |sum, (a, f)| sum + f * *a)
        };
        let (es, ep) = (along(s) * rs, along(p_in) * rp);
        let parts = s
            .to_array()
            .iter()
            .zip(p_out.to_array())
            .map(|(s, p)| es * *s + ep * p)
            .collect::<Vec<_>>();
        ([parts[0], parts[1], parts[2]], out)
    }

    /// Amplitudes of reflection from within, e^(−iωt), p_r = s × k_r.
    fn fresnel(&self, cosine: f64, n: f64) -> (Complex, Complex) {
        let behind = match self.back {
            Back::Perfect => return (real(-1.0), real(1.0)),
            Back::Uncoated => real(1.0),
            Back::Metal { n, k } => Complex::new(n, k),
        };
        let quotient = real(n) / behind;
        let sine2 = 1.0 - cosine * cosine;
        let beyond = (real(1.0) - quotient * quotient * sine2).root();
        let (n1, c1) = (real(n), real(cosine));
        let s = (n1 * c1 - behind * beyond) / (n1 * c1 + behind * beyond);
        let p = (behind * c1 - n1 * beyond) / (behind * c1 + n1 * beyond);
        (s, p)
    }
}

/// A direction that goes down into glass of an index, unit vectors.
fn refracted(down: DVec3, n: f64) -> DVec3 {
    let (x, y) = (down.x / n, down.y / n);
    DVec3::new(x, y, -(1.0 - x * x - y * y).max(0.0).sqrt())
}

/// The edges from the vertex, which are the inward normals of the faces: at 54.7° to the front's normal.
fn edges() -> [DVec3; 3] {
    let (across, up) = ((2.0_f64 / 3.0).sqrt(), (1.0_f64 / 3.0).sqrt());
    [0.0, 1.0, 2.0].map(|k| {
        let (sin, cos) = (k * TAU / 3.0).sin_cos();
        DVec3::new(across * cos, across * sin, up)
    })
}

/// The faces' normals where the dihedral angles exceed 90° by δ: their scalar products are sin δ.
fn leaning(dihedral_rad: f64) -> [DVec3; 3] {
    let e = edges();
    let half = 0.5 * dihedral_rad.sin();
    [0, 1, 2].map(|k| (e[k] + half * (e[(k + 1) % 3] + e[(k + 2) % 3])).normalize())
}

/// s and p = s × k of a direction at the front, whose normal is z.
fn basis(way: DVec3) -> (DVec3, DVec3) {
    // At normal incidence any axis serves.
    let s = DVec3::new(-way.y, way.x, 0.0).try_normalize().unwrap_or(DVec3::X);
    (s, s.cross(way))
}

/// The azimuths on the front, about the vertex' image, of rays that meet the faces in an order.
fn sector(edges: &[DVec3; 3], d: DVec3, order: &[usize; 3]) -> [f64; 2] {
    // A ray that enters at q (from the image) leaves at −q and meets face k after a way that grows with q·e_k/|d·e_k|.
    let rate = |k: usize| {
        let e = edges[k];
        [e.x / -d.dot(e), e.y / -d.dot(e)]
    };
    let [a, b, c] = order.map(rate);
    let later = |first: [f64; 2], then: [f64; 2]| [then[0] - first[0], then[1] - first[1]];
    // q·(b − a) > 0 and q·(c − b) > 0: the wedge between two half planes; the exit is on the other side.
    let (g, h) = (later(a, b), later(b, c));
    let (g, h) = ((-g[1]).atan2(-g[0]), (-h[1]).atan2(-h[0]));
    // The wedge's middle lies within 90° of both; its edges are 90° from one of them each.
    let turn = (h - g).sin().atan2((h - g).cos());
    let (low, high) = if turn > 0.0 {
        (g + turn - 0.5 * PI, g + 0.5 * PI)
    } else {
        (g - 0.5 * PI, g + turn + 0.5 * PI)
    };
    [low, high]
}

/// A cube in light from one direction.
struct Light {
    wedges: Vec<Wedge>,
    disc: Disc,
    cosine: f64,
}

/// The part of the front where rays enter and leave: two discs, `apart` each from their common middle.
struct Disc {
    radius: f64,
    apart: f64,
    toward: f64,
}

impl Disc {
    /// How far it reaches from its middle in an azimuth, m.
    fn reach(&self, azimuth: f64) -> f64 {
        let angle = azimuth - self.toward;
        let (along, across) = (self.apart * angle.cos().abs(), self.apart * angle.sin());
        (self.radius * self.radius - across * across).max(0.0).sqrt() - along
    }
}

/// Rays of one order of faces.
struct Wedge {
    /// Azimuths about the middle, where they leave.
    edges: [f64; 2],
    jones: [[Complex; 2]; 2],
    /// Tangential direction of its beam from that of the antiparallel one.
    tilt: [f64; 2],
}

impl Wedge {
    /// ∬ exp(i slope·x) dx dy over the wedge, m².
    fn integral(&self, disc: &Disc, slope: [f64; 2]) -> Complex {
        let [low, high] = self.edges;
        // The two discs' outlines cross in two azimuths, where the integrand has kinks.
        let mut cuts = vec![low, high];
        for k in -4..=4 {
            let kink = disc.toward + (f64::from(k) + 0.5) * PI;
            if kink > low && kink < high {
                cuts.push(kink);
            }
        }
        cuts.sort_by(f64::total_cmp);
        let mut sum = Complex::default();
        // Turns of the phase around the rim: a piece has few of them.
        let phase = slope[0].hypot(slope[1]) * disc.radius;
        for piece in cuts.windows(2) {
            let width = piece[1] - piece[0];
            let parts = 1 + (phase * width / 6.0).min(1e3) as u32;
            let half = 0.5 * width / f64::from(parts);
            for part in 0..parts {
                let middle = piece[0] + (2.0 * f64::from(part) + 1.0) * half;
                for (node, weight) in nodes() {
                    let azimuth = middle + half * node;
                    let (sin, cos) = azimuth.sin_cos();
                    let slope = slope[0] * cos + slope[1] * sin;
                    sum = sum + radial(slope, disc.reach(azimuth)) * (weight * half);
                }
            }
        }
        sum
    }
}

fn nodes() -> &'static [(f64, f64)] {
    static NODES: std::sync::LazyLock<Vec<(f64, f64)>> =
        std::sync::LazyLock::new(|| gauss::legendre(ORDER));
    &NODES
}

/// ∫₀ᴿ r e^(iκr) dr.
fn radial(kappa: f64, reach: f64) -> Complex {
    let x = kappa * reach;
    let square = reach * reach;
    if x.abs() < 0.02 {
        return Complex::new(0.5 - x * x / 8.0 + x.powi(4) / 144.0, x / 3.0 - x.powi(3) / 30.0)
            * square;
    }
    let turned = Complex::turn(x) * Complex::new(1.0, -x);
    (turned - real(1.0)) * (square / (x * x))
}

/// A set of cubes on a body.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Array {
    /// The cubes.
    pub cubes: Vec<CornerCube>,
}

impl Array {
    /// Cross-section of the whole, m²: an incoherent sum, which holds where the cubes' ranges differ by much more than a wavelength. `toward` and `offset_rad` as in [`CornerCube::cross_section_m2`].
    pub fn cross_section_m2(&self, nm: f64, toward: DVec3, offset_rad: DVec3) -> f64 {
        self.cubes.iter().map(|c| c.cross_section_m2(nm, toward, offset_rad)).sum()
    }

    /// Farthest that a cube and its glass reach from the body's origin, m.
    pub fn reach_m(&self) -> f64 {
        let one = |c: &CornerCube| c.position_m.length() + 2.0 * c.diameter_m;
        self.cubes.iter().map(one).fold(0.0, f64::max)
    }

    /// Largest distance between cubes that return light, across the line of sight, m; 0 of one cube.
    pub fn across_m(&self, nm: f64, toward: DVec3) -> f64 {
        let axis = toward.any_orthonormal_vector();
        let lit = |c: &&CornerCube| c.active_area_m2(nm, toward) > 0.0;
        let mut widest = 0.0_f64;
        for k in 0..8 {
            let axis = DQuat::from_axis_angle(toward, f64::from(k) * PI / 8.0) * axis;
            let ends = self.cubes.iter().filter(lit).map(|c| c.position_m.dot(axis));
            let ends =
                ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            widest = widest.max(ends.1 - ends.0);
        }
        widest.max(0.0)
    }
}

/// Probability that a shot of `mean` detected photons in the mean yields none, where `speckles` independent cells of speckle share the receiver: (1 + n̄/µ)^(−µ), averaged over lognormal scintillation of the
/// laser's way up whose logarithm has the variance `scintillation` (mean 1). With µ → ∞ it is Poisson's e^(−n̄).
pub fn none_of_speckled(mean: f64, speckles: f64, scintillation: f64) -> f64 {
    let none = |n: f64| (-speckles * (n / speckles).ln_1p()).exp();
    if scintillation <= 0.0 {
        return none(mean);
    }
    // The normal distribution by its own quadrature: midpoints over ±8σ err below 1e-12 for smooth integrands.
    let sigma = scintillation.sqrt();
    let steps = 160;
    let (mut sum, mut weights) = (0.0, 0.0);
    for i in 0..steps {
        let z = -8.0 + 16.0 * (f64::from(i) + 0.5) / f64::from(steps);
        let weight = (-0.5 * z * z).exp();
        sum += weight * none(mean * (sigma * z - 0.5 * scintillation).exp());
        weights += weight;
    }
    sum / weights
}
