//! Random numbers by number: each frame, bin and block has its own stream, so that what comes out does not depend on what was asked before.

use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;

/// The generator of every stream.
pub type Random = Xoshiro256PlusPlus;

/// Purpose of a stream: streams of different purposes have nothing in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Purpose {
    /// Photons and dark counts, a block each.
    Arrivals,
    /// The counts of a bin.
    Bin,
    /// The noise of a frame.
    Frame,
    /// Particles and objects that pass through a frame: cosmic rays, streaks.
    Passing,
    /// The pixels' own faults.
    Pixels,
    /// A quantity that wanders in time.
    Wander,
    /// True properties of a night's stars.
    Stars,
    /// A seed for something of its own (a channel, a device).
    Part,
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood 2014): every bit of the result depends on every bit of the argument.
pub(crate) fn mix(mut bits: u64) -> u64 {
    bits = bits.wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// A number in [0, 1) from 64 random bits.
pub(crate) fn fraction(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
}

/// The seed of one thing among many.
pub fn seed_of(seed: u64, purpose: Purpose, number: u64) -> u64 {
    mix(mix(mix(seed) ^ (purpose as u64 + 1)) ^ number)
}

/// The stream of one thing among many.
pub fn stream(seed: u64, purpose: Purpose, number: u64) -> Random {
    Random::seed_from_u64(seed_of(seed, purpose, number))
}
