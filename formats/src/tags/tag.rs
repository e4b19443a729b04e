//! One tag, and a view of many over bytes.

use super::TagError;

/// Bytes of one record.
pub const RECORD_BYTES: usize = 16;

/// The types of record that the vendor defines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum TagKind {
    /// An edge on a channel: the only type that may be a photon.
    TimeTag = 0,
    /// The counter reports an error; its clock may have jumped.
    Error = 1,
    /// From here on events are dropped.
    OverflowBegin = 2,
    /// The dropping ended.
    OverflowEnd = 3,
    /// So many events of a channel were dropped.
    MissedEvents = 4,
}

impl TagKind {
    /// The type with this number, if the vendor defines it.
    pub fn from_byte(byte: u8) -> Option<Self> {
        Some(match byte {
            0 => Self::TimeTag,
            1 => Self::Error,
            2 => Self::OverflowBegin,
            3 => Self::OverflowEnd,
            4 => Self::MissedEvents,
            _ => return None,
        })
    }
}

/// One record, field by field as it stands in the file: nothing is lost on the way in or out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Tag {
    /// The number of the type; see [`Tag::kind`].
    pub kind_byte: u8,
    /// Should be 0.
    pub reserved: u8,
    /// How many events were missed; has a meaning for [`TagKind::MissedEvents`] only.
    pub missed: u16,
    /// The channel: rising edges from 1 upwards, falling edges negative.
    pub channel: i32,
    /// Time on the counter's clock, ps.
    pub time_ps: i64,
}

impl Tag {
    const fn of_kind(kind: TagKind, missed: u16, channel: i32, time_ps: i64) -> Self {
        Self { kind_byte: kind as u8, reserved: 0, missed, channel, time_ps }
    }

    /// An edge on a channel.
    pub const fn photon(channel: i32, time_ps: i64) -> Self {
        Self::of_kind(TagKind::TimeTag, 0, channel, time_ps)
    }

    /// The counter reports an error.
    pub const fn error(time_ps: i64) -> Self {
        Self::of_kind(TagKind::Error, 0, 0, time_ps)
    }

    /// From here on events are dropped.
    pub const fn overflow_begin(time_ps: i64) -> Self {
        Self::of_kind(TagKind::OverflowBegin, 0, 0, time_ps)
    }

    /// The dropping ended.
    pub const fn overflow_end(time_ps: i64) -> Self {
        Self::of_kind(TagKind::OverflowEnd, 0, 0, time_ps)
    }

    /// `missed` events of a channel were dropped.
    pub const fn missed_events(channel: i32, missed: u16, time_ps: i64) -> Self {
        Self::of_kind(TagKind::MissedEvents, missed, channel, time_ps)
    }

    /// The type, or `None` if its number is not defined.
    pub fn kind(&self) -> Option<TagKind> {
        TagKind::from_byte(self.kind_byte)
    }

    /// The tag in a record.
    pub fn from_bytes(record: &[u8; RECORD_BYTES]) -> Self {
        let all = u128::from_le_bytes(*record);
        Self {
            kind_byte: all as u8,
            reserved: (all >> 8) as u8,
            missed: (all >> 16) as u16,
            channel: (all >> 32) as i32,
            time_ps: (all >> 64) as i64,
        }
    }

    /// The record of this tag.
    pub fn to_bytes(&self) -> [u8; RECORD_BYTES] {
        let low = u64::from(self.kind_byte)
            | u64::from(self.reserved) << 8
            | u64::from(self.missed) << 16
            | u64::from(self.channel as u32) << 32;
        (u128::from(low) | u128::from(self.time_ps as u64) << 64).to_le_bytes()
    }
}

/// Tags over bytes that somebody else holds: nothing is copied, and each record is decoded when it is asked for, whatever
/// the byte order of the computer.
#[derive(Debug, Clone, Copy)]
pub struct Tags<'a> {
    records: &'a [[u8; RECORD_BYTES]],
}

impl<'a> Tags<'a> {
    /// A view over whole records.
    ///
    /// # Errors
    /// [`TagError::NotWhole`] if bytes are left over; [`Tags::whole_records`] leaves them out.
    pub fn new(bytes: &'a [u8]) -> Result<Self, TagError> {
        let (records, torn) = bytes.as_chunks();
        if torn.is_empty() {
            return Ok(Self { records });
        }
        Err(TagError::NotWhole {
            bytes: bytes.len(),
            records: records.len(),
            torn: torn.len(),
            at_byte: bytes.len() - torn.len(),
        })
    }

    /// A view over the whole records of `bytes`, and the bytes that are left over.
    pub fn whole_records(bytes: &'a [u8]) -> (Self, &'a [u8]) {
        let (records, torn) = bytes.as_chunks();
        (Self { records }, torn)
    }

    /// A view over records.
    pub fn of_records(records: &'a [[u8; RECORD_BYTES]]) -> Self {
        Self { records }
    }

    /// The records themselves.
    pub fn records(&self) -> &'a [[u8; RECORD_BYTES]] {
        self.records
    }

    /// How many tags there are.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// The tag at a place counted from 0.
    pub fn get(&self, index: usize) -> Option<Tag> {
        self.records.get(index).map(Tag::from_bytes)
    }

    /// The tags, one after the other.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Tag> + DoubleEndedIterator + use<'a> {
        self.records.iter().map(Tag::from_bytes)
    }

    /// The tags from `from_ps` to before `to_ps`, found by binary search once all are seen to be in time.
    ///
    /// # Errors
    /// [`TagError::Unsorted`] with the first tag that is earlier than the one before it, since then a search finds only
    /// some of them; [`TagError::Span`] if `to_ps` is before `from_ps`.
    pub fn slice(&self, from_ps: i64, to_ps: i64) -> Result<Self, TagError> {
        if to_ps < from_ps {
            return Err(TagError::Span { from_ps, to_ps });
        }
        if let Some(fault) = first_unsorted(self.records, None, 0) {
            return Err(fault);
        }
        let before = |limit: i64| {
            self.records.partition_point(|record| Tag::from_bytes(record).time_ps < limit)
        };
        Ok(Self { records: &self.records[before(from_ps)..before(to_ps)] })
    }
}

/// The first record that is earlier than the one before it. `before_ps` is the time before the first of `records`, which is
/// record `number` of the whole.
pub(super) fn first_unsorted(
    records: &[[u8; RECORD_BYTES]],
    before_ps: Option<i64>,
    number: u64,
) -> Option<TagError> {
    let mut before_ps = before_ps.unwrap_or(i64::MIN);
    for (index, record) in records.iter().enumerate() {
        let time_ps = Tag::from_bytes(record).time_ps;
        if time_ps < before_ps {
            return Some(TagError::Unsorted { record: number + index as u64, time_ps, before_ps });
        }
        before_ps = time_ps;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    // Truth: the layout in the vendor's C++ header as libtcspc reads it, written out by hand.
    #[test]
    fn the_layout_is_the_vendors() {
        let tag = Tag::missed_events(-3, 0x1234, 0x0102_0304_0506_0708);
        let bytes = [4, 0, 0x34, 0x12, 0xfd, 0xff, 0xff, 0xff, 8, 7, 6, 5, 4, 3, 2, 1];
        assert_eq!(tag.to_bytes(), bytes);
        assert_eq!(Tag::from_bytes(&bytes), tag);
        let odd = [9, 7, 1, 0, 0, 0, 0, 0x80, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff];
        let tag = Tag::from_bytes(&odd);
        assert_eq!((tag.kind(), tag.reserved, tag.missed), (None, 7, 1));
        assert_eq!((tag.channel, tag.time_ps), (i32::MIN, -1));
        assert_eq!(tag.to_bytes(), odd);
    }

    #[test]
    fn a_view_is_whole_or_says_where_it_is_not() {
        let bytes = [0; 37];
        let error = Tags::new(&bytes).unwrap_err().to_string();
        assert_eq!(
            error,
            "37 bytes are 2 whole records of 16 bytes and 5 bytes of one that is torn, at byte 32"
        );
        let (tags, torn) = Tags::whole_records(&bytes);
        assert_eq!((tags.len(), torn.len()), (2, 5));
        assert!(Tags::new(&[]).unwrap().is_empty());
        assert_eq!(Tags::new(&[0; 16]).unwrap().get(1), None);
    }

    #[test]
    fn slices_are_half_open_and_refuse_what_has_no_order() {
        let of = |times: &[i64]| -> Vec<u8> {
            times.iter().flat_map(|&time| Tag::photon(1, time).to_bytes()).collect()
        };
        let bytes = of(&[i64::MIN, -5, -5, 0, 7, 7, 9, i64::MAX]);
        let tags = Tags::new(&bytes).unwrap();
        let cut = |from, to| -> Vec<i64> {
            tags.slice(from, to).unwrap().iter().map(|tag| tag.time_ps).collect()
        };
        assert_eq!(cut(-5, 7), [-5, -5, 0]);
        assert_eq!(cut(-4, 8), [0, 7, 7]);
        assert_eq!(cut(i64::MIN, i64::MAX).len(), 7);
        assert!(cut(8, 8).is_empty());
        assert!(matches!(tags.slice(1, 0), Err(TagError::Span { .. })));
        let bytes = of(&[3, 4, 2]);
        assert_eq!(
            Tags::new(&bytes).unwrap().slice(0, 9).unwrap_err().to_string(),
            "the tags are not in time: record 2 (byte 32) is at 2 ps, after one at 4 ps; binning needs no order, cutting does"
        );
    }
}
