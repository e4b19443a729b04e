//! A sample on a goniometer, from retro-reflection to a measured material.

pub mod retro;
