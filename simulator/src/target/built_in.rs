//! The targets that the program knows by name.

use super::Target;

/// Name and text of each, in the order in which they are listed.
const TARGETS: [(&str, &str); 14] = [
    ("box_wing", include_str!("../../targets/box_wing.toml")),
    ("box_wing_diffuse", include_str!("../../targets/box_wing_diffuse.toml")),
    ("hexagon", include_str!("../../targets/hexagon.toml")),
    ("box_with_panels", include_str!("../../targets/box_with_panels.toml")),
    ("corner", include_str!("../../targets/corner.toml")),
    ("lambert_sphere", include_str!("../../targets/lambert_sphere.toml")),
    ("mirror_sphere", include_str!("../../targets/mirror_sphere.toml")),
    ("cube", include_str!("../../targets/cube.toml")),
    ("calsphere_4a", include_str!("../../targets/calsphere_4a.toml")),
    ("lcs_1", include_str!("../../targets/lcs_1.toml")),
    ("ajisai", include_str!("../../targets/ajisai.toml")),
    ("lageos", include_str!("../../targets/lageos.toml")),
    ("topex", include_str!("../../targets/topex.toml")),
    ("flying_laptop", include_str!("../../targets/flying_laptop.toml")),
];

impl Target {
    /// The names of the built-in targets.
    pub fn built_in_names() -> Vec<&'static str> {
        TARGETS.iter().map(|(name, _)| *name).collect()
    }

    /// The text of a built-in target, to start an own one from.
    pub fn built_in_text(name: &str) -> Option<&'static str> {
        TARGETS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
    }

    /// A built-in target; `None` where there is none of that name.
    pub fn built_in(name: &str) -> Option<Self> {
        // A test reads every one of them, so that this is `None` for unknown names only.
        Self::parse(format!("embedded:{name}"), Self::built_in_text(name)?).ok()
    }
}
