//! The 32-bit records and their rolling clock.

/// Marker number n of the instrument (from 1) is the tag channel `MARKER_CHANNEL` + n.
pub const MARKER_CHANNEL: i32 = 1000;

/// Who wrote the records, and in which mode: the numbers of the header entry `TTResultFormat_TTTRRecType`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum RecordType {
    /// PicoHarp 300, T2.
    PicoHarpT2,
    /// PicoHarp 300, T3.
    PicoHarpT3,
    /// HydraHarp, version 1, T2.
    HydraHarpT2,
    /// HydraHarp, version 1, T3.
    HydraHarpT3,
    /// HydraHarp, version 2, T2.
    HydraHarp2T2,
    /// HydraHarp, version 2, T3.
    HydraHarp2T3,
    /// TimeHarp 260 N, T2.
    TimeHarp260NT2,
    /// TimeHarp 260 N, T3.
    TimeHarp260NT3,
    /// TimeHarp 260 P, T2.
    TimeHarp260PT2,
    /// TimeHarp 260 P, T3.
    TimeHarp260PT3,
    /// MultiHarp and PicoHarp 330, T2.
    GenericT2,
    /// MultiHarp and PicoHarp 330, T3.
    GenericT3,
}

impl RecordType {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::PicoHarpT2,
        Self::PicoHarpT3,
        Self::HydraHarpT2,
        Self::HydraHarpT3,
        Self::HydraHarp2T2,
        Self::HydraHarp2T3,
        Self::TimeHarp260NT2,
        Self::TimeHarp260NT3,
        Self::TimeHarp260PT2,
        Self::TimeHarp260PT3,
        Self::GenericT2,
        Self::GenericT3,
    ];

    /// The number in the header.
    pub fn number(self) -> i64 {
        match self {
            Self::PicoHarpT2 => 0x0001_0203,
            Self::PicoHarpT3 => 0x0001_0303,
            Self::HydraHarpT2 => 0x0001_0204,
            Self::HydraHarpT3 => 0x0001_0304,
            Self::HydraHarp2T2 => 0x0101_0204,
            Self::HydraHarp2T3 => 0x0101_0304,
            Self::TimeHarp260NT2 => 0x0001_0205,
            Self::TimeHarp260NT3 => 0x0001_0305,
            Self::TimeHarp260PT2 => 0x0001_0206,
            Self::TimeHarp260PT3 => 0x0001_0306,
            Self::GenericT2 => 0x0001_0207,
            Self::GenericT3 => 0x0001_0307,
        }
    }

    /// The type with this number.
    pub fn from_number(number: i64) -> Option<Self> {
        Self::ALL.into_iter().find(|one| one.number() == number)
    }

    /// Whether times are syncs and a delay (T3), not ticks (T2).
    pub fn is_t3(self) -> bool {
        self.number() & 0xff00 == 0x0300
    }

    fn is_pico_harp(self) -> bool {
        matches!(self, Self::PicoHarpT2 | Self::PicoHarpT3)
    }

    /// After how many ticks or syncs the clock of the records starts anew.
    pub fn rollover(self) -> u64 {
        match self {
            Self::PicoHarpT2 => 210_698_240,
            Self::PicoHarpT3 => 65_536,
            Self::HydraHarpT2 => 33_552_000,
            _ if self.is_t3() => 1_024,
            _ => 33_554_432,
        }
    }
}

/// Content of one record. `count` is the unrolled clock: ticks of `MeasDesc_GlobalResolution` since the start in T2 mode, the
/// number of the sync period in T3 mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Record {
    /// An event on an input.
    Photon {
        /// The input, from 1 as on the housing. A PicoHarp in T2 mode records its sync input as 0.
        input: u8,
        /// Ticks (T2) or syncs (T3).
        count: u64,
        /// T3 only: the delay since that sync, in units of `MeasDesc_Resolution`.
        dtime: Option<u16>,
    },
    /// An event on the sync input (T2).
    Sync {
        /// Ticks.
        count: u64,
    },
    /// One or more external markers.
    Markers {
        /// Bit 0 is marker 1.
        bits: u16,
        /// Ticks (T2) or syncs (T3).
        count: u64,
    },
    /// The clock rolled over; no event was lost.
    Rollover {
        /// How many times.
        times: u32,
    },
    /// A record that no document defines.
    Unknown {
        /// The record.
        raw: u32,
        /// Where the unrolled clock stands at least.
        count: u64,
    },
}

/// The clock of the records rolled beyond 2⁶⁴: the file is damaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the clock rolled over so often that its count is beyond 64 bits")]
pub struct RolledTooFar;

/// Decodes one record after the other and unrolls the clock.
#[derive(Debug, Clone)]
pub struct Decoder {
    kind: RecordType,
    /// Ticks or syncs before the present turn of the clock.
    base: u64,
}

impl Decoder {
    /// For records of a type, from the first one on.
    pub fn new(kind: RecordType) -> Self {
        Self { kind, base: 0 }
    }

    /// Decodes the next record.
    ///
    /// # Errors
    /// [`RolledTooFar`] if the unrolled clock no longer fits in 64 bits.
    pub fn decode(&mut self, raw: u32) -> Result<Record, RolledTooFar> {
        match (self.kind.is_pico_harp(), self.kind.is_t3()) {
            (true, false) => self.pico_harp_t2(raw),
            (true, true) => self.pico_harp_t3(raw),
            (false, t3) => self.hydra_harp(raw, t3),
        }
    }

    fn count(&self, clock: u32) -> Result<u64, RolledTooFar> {
        self.base.checked_add(clock.into()).ok_or(RolledTooFar)
    }

    fn roll_over(&mut self, times: u32) -> Result<Record, RolledTooFar> {
        // At most 2²⁵ turns of 2²⁸ ticks.
        let ticks = u64::from(times) * self.kind.rollover();
        self.base = self.base.checked_add(ticks).ok_or(RolledTooFar)?;
        Ok(Record::Rollover { times })
    }

    fn unknown(&self, raw: u32) -> Record {
        Record::Unknown { raw, count: self.base }
    }

    /// Channel 4 bits, clock 28 bits; in special records (channel 15) the last 4 bits of the clock are markers.
    fn pico_harp_t2(&mut self, raw: u32) -> Result<Record, RolledTooFar> {
        let clock = raw & 0x0fff_ffff;
        match ((raw >> 28) as u8, (raw & 0xf) as u16) {
            (15, 0) => self.roll_over(1),
            // The bits of the markers are no part of the time (as in libtcspc; the demos leave them in).
            (15, bits) => Ok(Record::Markers { bits, count: self.count(clock & !0xf)? }),
            (input @ 0..=4, _) => {
                Ok(Record::Photon { input, count: self.count(clock)?, dtime: None })
            }
            _ => Ok(self.unknown(raw)),
        }
    }

    /// Channel 4 bits, delay 12 bits, syncs 16 bits; in special records (channel 15) the delay is markers.
    fn pico_harp_t3(&mut self, raw: u32) -> Result<Record, RolledTooFar> {
        let (clock, dtime) = (raw & 0xffff, (raw >> 16 & 0xfff) as u16);
        match ((raw >> 28) as u8, dtime) {
            (15, 0) => self.roll_over(1),
            (15, bits) => Ok(Record::Markers { bits, count: self.count(clock)? }),
            (input @ 1..=4, _) => {
                Ok(Record::Photon { input, count: self.count(clock)?, dtime: Some(dtime) })
            }
            _ => Ok(self.unknown(raw)),
        }
    }

    /// Special 1 bit, channel 6 bits, then the clock of 25 bits (T2), or the delay of 15 bits and syncs of 10 bits (T3).
    fn hydra_harp(&mut self, raw: u32, t3: bool) -> Result<Record, RolledTooFar> {
        let special = raw >> 31 == 1;
        let channel = (raw >> 25 & 0x3f) as u8;
        let clock = if t3 { raw & 0x3ff } else { raw & 0x1ff_ffff };
        let one_by_one = matches!(self.kind, RecordType::HydraHarpT2 | RecordType::HydraHarpT3);
        match (special, channel) {
            (false, _) => Ok(Record::Photon {
                input: channel + 1,
                count: self.count(clock)?,
                dtime: t3.then_some((raw >> 10 & 0x7fff) as u16),
            }),
            // A count of 0 is how old firmware wrote a single turn.
            (true, 63) => self.roll_over(if one_by_one { 1 } else { clock.max(1) }),
            (true, 0) if !t3 => Ok(Record::Sync { count: self.count(clock)? }),
            (true, bits @ 1..=15) => {
                Ok(Record::Markers { bits: bits.into(), count: self.count(clock)? })
            }
            (true, _) => Ok(self.unknown(raw)),
        }
    }
}
