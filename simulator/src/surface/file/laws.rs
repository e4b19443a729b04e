//! The keys of the laws that other tools and laboratories use, of foils and of measured materials.

use super::{
    BaseFile, DoubtFile, LobeFile, LobeMasking, LobeName, MaterialFile, ModelName, Reader, coat,
};
use crate::surface::scatter::Stated;
use crate::surface::{
    CompositeLobe, CookTorranceLobe, Diffuse, Distribution, Gloss, Lobe, Masking, Material,
    MaterialError, MaxwellBeard, MirrorTerm, brdf_table, measured,
};
use sunglint_formats::bsdf::TensorFile;
use sunglint_formats::toml::{Finite, Positive};
use sunglint_formats::{FileError, ParseError};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

use ModelName::{
    Abg, Blend, BrdfTable, Composite, CookTorrance, Foil, Lambert, MaxwellBeard as Beard, Measured,
    Microfacet, Mirror, Phong, Ward,
};

/// Models whose own light is a reflectance times a function of direction.
const REFLECTANCE: [ModelName; 9] =
    [Lambert, Microfacet, Mirror, Blend, Phong, Ward, Abg, CookTorrance, Composite];
const DIFFUSE: [ModelName; 6] = [Phong, Ward, Abg, Beard, CookTorrance, Composite];
const FRESNEL: [ModelName; 5] = [Microfacet, Mirror, Blend, CookTorrance, Composite];

impl Material {
    /// Notes how well a fitted material is known.
    pub(super) fn doubt(&mut self, doubt: &DoubtFile) {
        let colour = doubt.colour_ln.map_or(0.0, Finite::get);
        self.stated = Some(Stated {
            peak_ln: doubt.peak_ln.get().hypot(colour),
            wings_ln: doubt.wings_ln.get().hypot(colour),
            grazing_ln: doubt.grazing_ln.get().hypot(colour),
        });
        let percent = |ln: Finite| 100.0 * ln.get().exp_m1();
        self.notes.push(format!(
            "it was fitted: f is known to {:.0} % about the mirrored direction, {:.0} % elsewhere, {:.0} % at grazing angles (95 %)",
            percent(doubt.peak_ln),
            percent(doubt.wings_ln),
            percent(doubt.grazing_ln)
        ));
        self.notes.extend(doubt.said.iter().cloned());
    }
}

impl Reader<'_> {
    /// Refuses keys that the model has no use for.
    pub(super) fn check_use(&self, file: &MaterialFile) -> Result<(), ParseError> {
        let given: [(&str, bool, &[ModelName]); 35] = [
            ("reflectance", file.reflectance.is_some(), &REFLECTANCE),
            ("reflectance_file", file.reflectance_file.is_some(), &REFLECTANCE),
            ("reflectance_table", file.reflectance_table.is_some(), &REFLECTANCE),
            ("distribution", file.distribution.is_some(), &[Microfacet, Blend]),
            ("alpha", file.alpha.is_some(), &[Microfacet, Blend, Ward]),
            ("alpha_x", file.alpha_x.is_some(), &[Microfacet, Blend, Ward]),
            ("alpha_y", file.alpha_y.is_some(), &[Microfacet, Blend, Ward]),
            ("masking", file.masking.is_some(), &[Microfacet, Blend, Foil]),
            ("fresnel", file.fresnel.is_some(), &FRESNEL),
            (
                "refractive_index",
                file.refractive_index.is_some(),
                &[Microfacet, Mirror, Blend, CookTorrance, Composite, Beard],
            ),
            ("n", file.n.is_some(), &FRESNEL),
            ("mirror", file.mirror.is_some(), &[Composite]),
            (
                "diffuse.power",
                file.diffuse.as_ref().is_some_and(|d| d.power.is_some()),
                &[Composite],
            ),
            (
                "base.power",
                [&file.base, &file.volume].into_iter().flatten().any(|b| b.power.is_some()),
                &[],
            ),
            ("base", file.base.is_some(), &[Blend]),
            ("file", file.file.is_some(), &[Measured, BrdfTable]),
            ("wavelength_nm", file.wavelength_nm.is_some(), &[BrdfTable]),
            ("floor_per_sr", file.floor_per_sr.is_some(), &[BrdfTable]),
            ("exponent", file.exponent.is_some(), &[Phong]),
            ("form", file.form.is_some(), &[Ward]),
            ("a_per_sr", file.a_per_sr.is_some(), &[Abg]),
            ("b", file.b.is_some(), &[Abg]),
            ("g", file.g.is_some(), &[Abg]),
            ("bias_per_sr", file.bias_per_sr.is_some(), &[Beard]),
            ("sigma", file.sigma.is_some(), &[Beard]),
            ("tau_deg", file.tau_deg.is_some(), &[Beard]),
            ("omega_deg", file.omega_deg.is_some(), &[Beard]),
            ("volume", file.volume.is_some(), &[Beard]),
            ("diffuse", file.diffuse.is_some(), &DIFFUSE),
            ("lobe", file.lobe.is_some(), &[CookTorrance, Composite]),
            ("slope_rms", file.slope_rms.is_some(), &[Foil]),
            ("slope_rms_x", file.slope_rms_x.is_some(), &[Foil]),
            ("slope_rms_y", file.slope_rms_y.is_some(), &[Foil]),
            ("of", file.of.is_some(), &[Foil]),
            ("note", file.note.is_some(), &[file.model]),
        ];
        let idle = given.iter().find(|(_, given, of)| *given && !of.contains(&file.model));
        if let Some((key, ..)) = idle {
            let expected = format!("no `{key}` with model = \"{}\"", file.model.name());
            return Err(self.error(key, expected));
        }
        Ok(())
    }

    pub(super) fn law(&mut self, file: &MaterialFile) -> Result<Material, FileError> {
        match file.model {
            Phong => {
                let exponent = self.number("exponent", file.exponent, "Phong's n")?;
                self.glossy(file, Gloss::Phong { exponent }, "exponent")
            }
            Ward => {
                let (alpha_x, alpha_y) =
                    self.pair("alpha", [file.alpha, file.alpha_x, file.alpha_y])?;
                let form = file.form.unwrap_or_default();
                self.glossy(file, Gloss::Ward { alpha_x, alpha_y, form }, "alpha")
            }
            Abg => {
                let a_per_sr = self.number("a_per_sr", file.a_per_sr, "A in sr⁻¹")?;
                let b = self.number("b", file.b, "B")?;
                let g = self.number("g", file.g, "the exponent g")?;
                self.glossy(file, Gloss::Abg { a_per_sr, b, g }, "a_per_sr")
            }
            Beard => self.maxwell_beard(file),
            CookTorrance => self.cook_torrance(file),
            Composite => self.composite(file),
            Foil => self.foil(file),
            Measured => {
                let (path, bytes) = self.bytes("file", self.named(file)?)?;
                let tensors = TensorFile::from_bytes(&path, &bytes)?;
                Ok(measured::material(&file.name, &path, &tensors)?)
            }
            _ => self.table(file),
        }
    }

    fn number(&self, key: &str, value: Option<Finite>, what: &str) -> Result<f64, ParseError> {
        value.map(Finite::get).ok_or_else(|| self.error(key, format!("also {key}: {what}")))
    }

    /// One number for both axes, or two.
    fn pair(&self, key: &str, given: [Option<Finite>; 3]) -> Result<(f64, f64), ParseError> {
        match given.map(|v| v.map(Finite::get)) {
            [Some(both), None, None] => Ok((both, both)),
            [None, Some(x), Some(y)] => Ok((x, y)),
            _ => Err(self.error(key, format!("either {key}, or {key}_x and {key}_y"))),
        }
    }

    fn part(
        &mut self,
        part: Option<&BaseFile>,
        prefix: &'static str,
    ) -> Result<Option<Spectrum<Reflectance>>, FileError> {
        part.map(|part| self.reflectance(&part.keys(prefix))).transpose()
    }

    fn glossy(
        &mut self,
        file: &MaterialFile,
        gloss: Gloss,
        key: &str,
    ) -> Result<Material, FileError> {
        let reflectance = self.reflectance(&coat(file))?;
        let diffuse = self.part(file.diffuse.as_ref(), "diffuse.")?;
        let made = Material::glossy(&file.name, gloss, reflectance, diffuse);
        made.map_err(|e| self.of_error(key, &e).into())
    }

    /// Says what is wrong where it was written: too much light at `reflectance`.
    fn of_error(&self, key: &str, error: &MaterialError) -> ParseError {
        match error {
            MaterialError::Gain { .. } => self.wrong("model", error),
            _ => self.wrong(key, error),
        }
    }

    fn maxwell_beard(&mut self, file: &MaterialFile) -> Result<Material, FileError> {
        let numbers = MaxwellBeard {
            bias_per_sr: self.number("bias_per_sr", file.bias_per_sr, "B in sr⁻¹")?,
            sigma: self.number("sigma", file.sigma, "the width of the tilts")?,
            tau_deg: self.number("tau_deg", file.tau_deg, "τ in degrees")?,
            omega_deg: self.number("omega_deg", file.omega_deg, "Ω in degrees")?,
        };
        let Some(name) = &file.refractive_index else {
            let expected = "also refractive_index: a material's name or a file";
            return Err(self.error("refractive_index", expected).into());
        };
        let index = self.index(name)?;
        let diffuse = self.part(file.diffuse.as_ref(), "diffuse.")?;
        let volume = self.part(file.volume.as_ref(), "volume.")?;
        Material::maxwell_beard(&file.name, numbers, &index, diffuse, volume)
            .map_err(|e| self.of_error("bias_per_sr", &e).into())
    }

    fn cook_torrance(&mut self, file: &MaterialFile) -> Result<Material, FileError> {
        let lobes = file.lobe.as_deref().unwrap_or_default();
        if lobes.is_empty() {
            return Err(self.error("lobe", "also [[material.lobe]]: one or more lobes").into());
        }
        let lobes = lobes
            .iter()
            .enumerate()
            .map(|(k, lobe)| self.cook_torrance_lobe(k, lobe))
            .collect::<Result<Vec<_>, _>>()?;
        let fresnel = self.fresnel(file)?;
        let diffuse = self.part(file.diffuse.as_ref(), "diffuse.")?;
        let made = Material::cook_torrance(&file.name, &lobes, &fresnel, diffuse);
        made.map_err(|e| self.of_error("lobe", &e).into())
    }

    fn cook_torrance_lobe(
        &self,
        number: usize,
        lobe: &LobeFile,
    ) -> Result<CookTorranceLobe, ParseError> {
        let kind = lobe.masking.unwrap_or_default();
        let (made, share) = self.facets(number, lobe, kind)?;
        Ok(CookTorranceLobe { lobe: made, grooves: kind == LobeMasking::VCavity, share })
    }

    /// The tilts, masking and share of a lobe of microfacets.
    fn facets(
        &self,
        number: usize,
        lobe: &LobeFile,
        kind: LobeMasking,
    ) -> Result<(Lobe, f64), ParseError> {
        let at = |key: &str| format!("lobe[{number}].{key}");
        let distribution = match lobe.distribution {
            LobeName::Beckmann => Distribution::Beckmann,
            LobeName::Ggx => Distribution::Ggx,
            LobeName::Abg => {
                let expected =
                    "\"beckmann\" or \"ggx\"; \"abg\" is a lobe of model = \"composite\"";
                return Err(self.error(&at("distribution"), expected));
            }
        };
        for (key, given) in [("a_per_sr", lobe.a_per_sr), ("b", lobe.b), ("g", lobe.g)] {
            if given.is_some() {
                let expected = format!("no `{key}` but with distribution = \"abg\"");
                return Err(self.error(&at(key), expected));
            }
        }
        let key = at("alpha");
        let (x, y) = self.pair(&key, [lobe.alpha, lobe.alpha_x, lobe.alpha_y])?;
        let masking = match kind {
            LobeMasking::HeightCorrelated => Masking::HeightCorrelated,
            _ => Masking::Separable,
        };
        let made = Lobe::anisotropic(distribution, x, y, masking);
        let made = made.map_err(|e| self.wrong(&key, &e))?;
        let share = lobe.share.ok_or_else(|| {
            self.error(&at("share"), "also share: what part of the microfacets it is")
        })?;
        Ok((made, share.get()))
    }

    fn composite(&mut self, file: &MaterialFile) -> Result<Material, FileError> {
        let lobes = file.lobe.as_deref().unwrap_or_default();
        let lobes = lobes
            .iter()
            .enumerate()
            .map(|(k, lobe)| self.composite_lobe(k, lobe))
            .collect::<Result<Vec<_>, _>>()?;
        let mirror = file.mirror.as_ref().map(|mirror| MirrorTerm {
            share: mirror.share.get(),
            g: mirror.g.map_or(0.0, Finite::get),
            alpha: mirror.alpha.get(),
            wavelength_nm: mirror.wavelength_nm.map(Positive::get),
        });
        let fresnel = self.fresnel(file)?;
        let diffuse = self.part(file.diffuse.as_ref(), "diffuse.")?.map(|reflectance| {
            let power = file.diffuse.as_ref().and_then(|d| d.power).map_or(0.0, Finite::get);
            Diffuse { reflectance, power }
        });
        let made = Material::composite(&file.name, &lobes, mirror, &fresnel, diffuse);
        made.map_err(|e| self.of_error("model", &e).into())
    }

    fn composite_lobe(&self, number: usize, lobe: &LobeFile) -> Result<CompositeLobe, ParseError> {
        if lobe.distribution != LobeName::Abg {
            let kind = lobe.masking.unwrap_or(LobeMasking::Separable);
            if kind == LobeMasking::VCavity {
                let expected = "\"separable\" or \"height_correlated\" in a composite";
                return Err(self.error(&format!("lobe[{number}].masking"), expected));
            }
            let (lobe, share) = self.facets(number, lobe, kind)?;
            return Ok(CompositeLobe::Facets { lobe, share });
        }
        let at = |key: &str| format!("lobe[{number}].{key}");
        let idle = [
            ("share", lobe.share.is_some()),
            ("masking", lobe.masking.is_some()),
            ("alpha", lobe.alpha.is_some()),
            ("alpha_x", lobe.alpha_x.is_some()),
            ("alpha_y", lobe.alpha_y.is_some()),
        ];
        if let Some((key, _)) = idle.iter().find(|(_, given)| *given) {
            let expected = format!("no `{key}` with distribution = \"abg\"");
            return Err(self.error(&at(key), expected));
        }
        Ok(CompositeLobe::Abg {
            a_per_sr: self.number(&at("a_per_sr"), lobe.a_per_sr, "A in sr⁻¹")?,
            b: self.number(&at("b"), lobe.b, "B")?,
            g: self.number(&at("g"), lobe.g, "the exponent g")?,
        })
    }

    fn foil(&mut self, file: &MaterialFile) -> Result<Material, FileError> {
        let Some(of) = &file.of else {
            return Err(self.error("of", "also of = { … }: the material that is wrinkled").into());
        };
        let slopes = [file.slope_rms, file.slope_rms_x, file.slope_rms_y];
        let (x, y) = self.pair("slope_rms", slopes)?;
        let at = self.key("of");
        let mut inner = Reader { document: self.document, at: &at, sources: Vec::new() };
        if of.model == Foil {
            return Err(inner.error("model", "a material that is no foil").into());
        }
        let base = inner.material(of)?;
        for source in inner.sources {
            if !self.sources.contains(&source) {
                self.sources.push(source);
            }
        }
        Material::foil(&file.name, base, x, y, file.masking.unwrap_or_default())
            .map_err(|e| self.of_error("slope_rms", &e).into())
    }

    fn named<'a>(&self, file: &'a MaterialFile) -> Result<&'a str, ParseError> {
        file.file.as_deref().ok_or_else(|| self.error("file", "also file: the measurements"))
    }

    fn table(&mut self, file: &MaterialFile) -> Result<Material, FileError> {
        let (path, content) = self.bytes("file", self.named(file)?)?;
        let nm = file.wavelength_nm.map(Finite::get);
        let (wavelengths, rows) = brdf_table::read(&path, content, nm)?;
        let floor = file.floor_per_sr.map(Finite::get);
        brdf_table::material(&file.name, &wavelengths, &rows, floor)
            .map_err(|e| ParseError::new(&path, e.to_string(), "a table of measured values").into())
    }
}
