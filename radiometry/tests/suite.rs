//! All tests of this crate: one program, so that one is linked.

mod air;
mod air_lowtran7;
mod air_near;
mod air_table_campaign;
mod sky_frames;
mod sky_many_frames;
mod sky_places;
mod sky_stars;
mod sky_time;
mod station;
