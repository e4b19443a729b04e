//! Flags of a sample: one bit each, by name in files.

bitflags::bitflags! {
    /// Flags of a sample. In files the metadata `flag_bits` names the bits, and the names decide.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct Flags: u32 {
        /// A detector or pixel at or past its saturation: the rate is excluded.
        const SATURATED = 1 << 0;
        /// No data here: a dropped frame, a device that was away.
        const GAP = 1 << 1;
        /// The target was outside the fibre's field.
        const OFF_AXIS = 1 << 2;
        /// A table was left: a material, a sensitivity or the air beyond its range.
        const EXTRAPOLATED = 1 << 3;
        /// A value stood in for a missing one: a black body for a spectrum, no Earth orientation.
        const FALLBACK = 1 << 4;
        /// The counter lost events: the rate is a lower bound.
        const OVERFLOW = 1 << 5;
        /// The light changed within the bin faster than it can be linearised.
        const FAST_GLINT = 1 << 6;
        /// Pixels of the aperture were masked.
        const MASKED_PIXELS = 1 << 7;
        /// Background from a stand-in (dark counts) where there was no off-target stretch.
        const NO_OFF_TARGET = 1 << 8;
        /// The target was in the Earth's penumbra or umbra.
        const ECLIPSED = 1 << 9;
        /// The target was below the station's horizon, or behind what stands there.
        const HIDDEN = 1 << 10;
        /// The channel has no exposure at this time: the row is another instrument's.
        const NOT_SAMPLED = 1 << 11;
        /// The target was not found in the frame, or not in both frames around the sample.
        const UNDETECTED = 1 << 12;
        /// The telescope looked beside the target: background, no target.
        const OFF_TARGET = 1 << 13;
        /// The point spread is narrower than 3 pixels of the plane that was measured: the rate depends on where in a pixel it fell.
        const UNDERSAMPLED = 1 << 14;
        /// The target moved in the exposure: measured in an aperture along its trail.
        const TRAILED = 1 << 15;
        /// Another source (a star, a streak, a cosmic ray) in the aperture.
        const CROWDED = 1 << 16;
        /// The aperture or its annulus leaves the frame.
        const EDGE = 1 << 17;
        /// The rate is where the model of the detector's dead time is no longer to be trusted, yet not saturated.
        const NONLINEAR = 1 << 18;
        /// The time comes from the computer's clock alone.
        const CLOCK_FREE = 1 << 19;
        /// A simulated rate's stated error is more than the tolerance that was asked for.
        const OVER_TOLERANCE = 1 << 20;
        /// Another program used the camera, too: the frame may be its own.
        const SHARED = 1 << 21;
    }
}

/// Flags that a sample may carry and still be measured: what they say is in its uncertainty or does not change its rate.
pub const TOLERATED: Flags = Flags::NO_OFF_TARGET
    .union(Flags::MASKED_PIXELS)
    .union(Flags::UNDERSAMPLED)
    .union(Flags::TRAILED)
    .union(Flags::CLOCK_FREE)
    .union(Flags::FALLBACK)
    .union(Flags::EXTRAPOLATED)
    .union(Flags::OVER_TOLERANCE)
    .union(Flags::SHARED);
