//! A curve and the light under which it was taken.

use sunglint_analysis::samples::{SampleValues, SampledCurve, SamplesError, Surroundings};
use sunglint_analysis::unmix::{Bands, Endmember, Light, Values};
use sunglint_radiometry::air::{Air, AirTable, Zenith};
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::station::Station;
use sunglint_simulator::pass::{Pass, PassError, Place};

/// A curve with all that reflection factors need.
#[derive(Debug, Clone)]
pub struct LitCurve {
    curve: SampledCurve,
    pass: Option<Pass>,
    station: Option<Station>,
    air: Option<Air>,
    places: Option<Vec<Place>>,
}

impl LitCurve {
    /// A curve of a scene, which says where Sun, target and station stood. With `above_air` its rates are those above the air.
    ///
    /// # Errors
    /// A time at which target, Sun or attitude have no place.
    pub fn of_scene(curve: SampledCurve, pass: Pass, above_air: bool) -> Result<Self, PassError> {
        let (own, rows) = (curve.samples(), (0..curve.samples().time.len()).collect::<Vec<_>>());
        let moments = pass.clone().at_times(own.time.clone(), own.exposure_s.clone(), &rows)?;
        let places = Some(moments.moments()?);
        let air = pass.air.clone().filter(|_| !above_air);
        Ok(Self { curve, station: None, air, places, pass: Some(pass) })
    }

    /// A curve of a station, through some air; its own columns say where the target stood.
    pub fn of_station(curve: SampledCurve, station: Option<Station>, air: Option<Air>) -> Self {
        Self { curve, pass: None, station, air, places: None }
    }

    /// The curve.
    pub fn curve(&self) -> &SampledCurve {
        &self.curve
    }

    /// The scene, where it is known.
    pub fn pass(&self) -> Option<&Pass> {
        self.pass.as_ref()
    }

    /// Where Sun, target and station stood at each sample, by the scene; `None` without one.
    pub fn places(&self) -> Option<&[Place]> {
        self.places.as_deref()
    }

    fn around(&self) -> Surroundings<'_> {
        let pass = self.pass.as_ref();
        Surroundings {
            sun: match pass {
                Some(pass) => &pass.sun,
                None => sun_at_1_au(),
            },
            station: pass.map(|p| &p.station).or(self.station.as_ref()),
            air: self.air.as_ref(),
            air_tolerance: pass.map_or(AirTable::TOLERANCE, |p| p.air_tolerance),
        }
    }

    /// The bands of the curve with some endmembers.
    ///
    /// # Errors
    /// The errors of [`SampledCurve::bands`].
    pub fn bands(&self, endmembers: &[Endmember]) -> Result<Bands, SamplesError> {
        self.curve.bands(&self.around(), endmembers)
    }

    /// The middle of each band, vacuum nm.
    ///
    /// # Errors
    /// The errors of [`SampledCurve::middles_nm`].
    pub fn middles_nm(&self) -> Result<Vec<f64>, SamplesError> {
        self.curve.middles_nm(&self.around())
    }

    /// Under what light each sample was taken, and its values, of which those without sunlight do not count.
    ///
    /// # Errors
    /// The errors of [`SampledCurve::lights`].
    pub fn samples(
        &self,
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<Light>, SampleValues), SamplesError> {
        let lights = match &self.places {
            Some(places) => places.iter().map(|place| self.light_at(place)).collect(),
            None => self.curve.lights(&self.around(), warnings)?,
        };
        let mut values = self.curve.values();
        // In the umbra nothing is reflected that could be divided.
        for (i, light) in lights.iter().enumerate() {
            if light.sunlight <= 0.0 {
                values.valid.row_mut(i).fill(false);
            }
        }
        Ok((lights, values))
    }

    fn light_at(&self, place: &Place) -> Light {
        Light {
            zenith: place.geometry.air_zenith(),
            range_m: if self.curve.is_intensity() { 1.0 } else { place.geometry.range_m },
            sunlight: place.sunlit / place.geometry.sun.distance_au().powi(2),
        }
    }

    /// Whether weights are in m² sr⁻¹, the ranges being known.
    pub fn is_absolute(&self) -> bool {
        self.curve.is_intensity() || self.places.is_some() || self.curve.samples().range_m.is_some()
    }
}

/// The values as views.
pub(crate) fn views(values: &SampleValues) -> Values<'_> {
    Values {
        value: values.value.view(),
        sigma: values.sigma.as_ref().map(|s| s.view()),
        valid: values.valid.view(),
    }
}

/// The first zenith angle at which the bands have an answer, else the zenith.
pub(crate) fn first_zenith(bands: &Bands, lights: &[Light]) -> Zenith {
    let zenith = lights.iter().map(|l| l.zenith).find(|z| bands.at(*z).is_ok());
    zenith.unwrap_or(Zenith::Apparent(0.0))
}
