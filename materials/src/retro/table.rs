//! A run as the table that [`crate::table`] reads.

use super::{Retro, Row, smallest_alpha};
use crate::table::RetroFlags;
use serde_json::json;
use sunglint_formats::flag_bits::bit_names;
use sunglint_formats::{Column, Meta, Table};

/// `angle_deg`, `f_per_sr`, `sigma_f_per_sr` (without what all angles have in common), its components, what they were made of, `flags`.
pub fn to_table(retro: &Retro) -> Table {
    let all = |value: &dyn Fn(&Row) -> f64| retro.rows.iter().map(value).collect::<Vec<f64>>();
    let sr = |name: &str, about: &str, value: &dyn Fn(&Row) -> f64| {
        Column::f64(name, Some("1 / sr"), all(value)).described(about)
    };
    let watt = |name: &str, about: &str, value: &dyn Fn(&Row) -> f64| {
        Column::f64(name, Some("W"), all(value)).described(about)
    };
    let count = |name: &str, about: &str, value: &dyn Fn(&Row) -> usize| {
        let whole = |row| i64::try_from(value(row)).unwrap_or(i64::MAX);
        Column::i64(name, None, retro.rows.iter().map(whole).collect()).described(about)
    };
    let columns = vec![
        Column::f64("angle_deg", Some("deg"), all(&|r| r.angle_deg)).described("the stage's angle"),
        Column::f64("time_s", Some("s"), all(&|r| r.time_s)).described("when it was read"),
        sr("f_per_sr", "retro-reflection, mean over the cone", &|r| r.f_per_sr),
        sr("sigma_f_per_sr", "standard uncertainty without what all angles have in common", &|r| {
            r.components.total_per_sr()
        }),
        sr("sigma_readout_per_sr", "of that, by the readings' scatter", &|r| {
            r.components.readout_per_sr
        }),
        sr("sigma_signature_per_sr", "by the scan without a sample", &|r| {
            r.components.signature_per_sr
        }),
        sr("sigma_drift_per_sr", "by the laser between incident readings, and their noise", &|r| {
            r.components.drift_per_sr
        }),
        sr("sigma_angle_per_sr", "by the stage's angle and the mount's offset", &|r| {
            r.components.angle_per_sr
        }),
        watt("power_w", "mean of the readings", &|r| r.power.power_w),
        watt("sigma_power_w", "its standard uncertainty", &|r| r.power.sigma_w),
        watt("signature_w", "without a sample", &|r| r.signature_w),
        watt("incident_w", "incident power at that time", &|r| r.incident_w),
        count("readings", "readings in the mean", &|r| r.power.used),
        count("left_out", "outliers", &|r| r.power.left_out),
        count("over", "readings over range", &|r| r.power.over),
        Column::f64("spilled", None, all(&|r| r.spilled))
            .described("part of the beam that passes beside the sample"),
        Column::i64("flags", None, retro.rows.iter().map(|r| i64::from(r.flags.bits())).collect()),
    ];
    Table { meta: meta(retro), columns }
}

fn meta(retro: &Retro) -> Meta {
    let notes: Vec<String> = retro.notes.iter().map(ToString::to_string).collect();
    let (zero_deg, zero_sigma_deg, zero_origin) = retro.zero;
    let incident = |(time_s, power_w, sigma_w): &(f64, f64, f64)| json!({ "time_s": time_s, "power_w": power_w, "sigma_w": sigma_w });
    [
        ("kind", json!("retro_reflection")),
        ("wavelength_nm", json!(retro.wavelength_nm)),
        ("cone_half_angle_deg", json!(retro.cone_half_angle_deg)),
        ("cone_spread_deg", json!(retro.cone_spread)),
        ("solid_angle_sr", json!(retro.solid_angle_sr)),
        ("smallest_alpha", json!(smallest_alpha(retro.cone_half_angle_deg))),
        ("scale_sigma", json!(retro.scale.total())),
        ("scale_sigma_by", json!(retro.scale)),
        ("zero_deg", json!(zero_deg)),
        ("zero_sigma_deg", json!(zero_sigma_deg)),
        ("zero_origin", json!(zero_origin)),
        ("incident", json!(retro.incident.iter().map(incident).collect::<Vec<_>>())),
        ("notes", json!(notes)),
        ("flag_bits", bit_names::<RetroFlags>()),
    ]
    .into_iter()
    .map(|(key, value)| (key.to_owned(), value))
    .collect()
}
