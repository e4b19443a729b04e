//! File of the fibres' fields: what the alignment writes and the reduction reads.

use super::Field;
use crate::reduction::counts::Fibres;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use sunglint_formats::FileError;
use sunglint_formats::toml::{Document, Finite, Positive};
use sunglint_radiometry::station::Fibre;

/// The file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FibreFile {
    fibre: BTreeMap<String, FibreTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FibreTable {
    offset_px: [Finite; 2],
    sigma_px: [Positive; 2],
    // For people: read, and not used.
    #[serde(default, rename = "offset_uncertainty_px")]
    _offset_uncertainty_px: Option<[Finite; 2]>,
    #[serde(default, rename = "sigma_uncertainty_px")]
    _sigma_uncertainty_px: Option<[Finite; 2]>,
}

/// Reads the fields that `sunglint align` found, by channel.
///
/// # Errors
/// A file that cannot be read, or holds something else.
pub fn read_fibres(path: &Path) -> Result<Fibres, FileError> {
    let document = Document::new(path, sunglint_formats::read::text(path)?)?;
    let file: FibreFile = document.parse()?;
    let fibre = |(name, table): (String, FibreTable)| {
        let FibreTable { offset_px, sigma_px, .. } = table;
        let fibre = Fibre {
            offset_px: offset_px.map(Finite::get).into(),
            sigma_px: sigma_px.map(Positive::get).into(),
        };
        (name, fibre)
    };
    Ok(file.fibre.into_iter().map(fibre).collect())
}

/// File of fields for the reduction or a station: TOML.
pub fn fibre_file(fields: &[Field]) -> String {
    let mut text = String::from(
        "# The fields of the fibres on the camera image, as `sunglint align` fitted them: for `sunglint reduce --fibre`,\n# or for `fibre_offset_px` and `fibre_sigma_px` of the station's counters.\n",
    );
    for field in fields {
        let fibre = field.fit.fibre();
        let [x, y, u, v, _] = field.fit.uncertainties();
        let _ = write!(
            text,
            "\n[fibre.{}]\noffset_px = [{:.4}, {:.4}]\nsigma_px = [{:.4}, {:.4}]\noffset_uncertainty_px = [{x:.4}, {y:.4}]\nsigma_uncertainty_px = [{u:.4}, {v:.4}]\n",
            field.channel,
            fibre.offset_px[0],
            fibre.offset_px[1],
            fibre.sigma_px[0],
            fibre.sigma_px[1]
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the numbers that stand in the file.
    #[test]
    fn fields_are_read_and_mistakes_named() {
        let folder = std::env::temp_dir().join(format!("sunglint-align-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("fibre.toml");
        let good = "[fibre.spcm]\noffset_px = [-1.5, 8]\nsigma_px = [14.5, 16.8]\noffset_uncertainty_px = [0.1, 0.1]\n";
        std::fs::write(&path, good).unwrap();
        let fibres = read_fibres(&path).unwrap();
        assert_eq!(
            fibres["spcm"],
            Fibre { offset_px: [-1.5, 8.0].into(), sigma_px: [14.5, 16.8].into() }
        );
        std::fs::write(&path, good.replace("16.8", "0")).unwrap();
        let error = read_fibres(&path).unwrap_err().to_string();
        assert!(error.contains("fibre.toml:3") && error.contains("sigma_px"), "{error}");
        std::fs::write(&path, good.replace("sigma_px = [", "sigma_pix = [")).unwrap();
        let error = read_fibres(&path).unwrap_err().to_string();
        assert!(error.contains("sigma_pix"), "{error}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
