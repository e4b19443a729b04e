//! The raw tags of a counter's bins: which of them belong to a bin, and whether they may be trusted.
//!
//! Tags and bins are written apart, and either may be cut or lost. What ties them together is that the tags of a bin are as many as its counts. The file is cut
//! into stretches of one clock: at error records, and where times go back. A run over all bins holds each stretch against the counts; a stretch of which
//! less than half of the bins agree is another clock's, and no tag of it is used, not even in bins that agree by chance.

use crate::counts::Bin;
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::PathBuf;
use sunglint_formats::session::Session;
use sunglint_formats::tags::{Recovered, Tag, TagFile, TagKind};
use sunglint_formats::{CountFlags, CountRecord, FileError};

/// Stretches further on that a bin is held against, where it does not agree with the present one.
const TRIED: usize = 16;
/// Tags in memory at once.
const READ: u64 = 1 << 14;

/// Tags in the order of one clock.
#[derive(Debug, Clone, PartialEq)]
struct Stretch {
    records: Range<u64>,
    /// Times of the first and of the last record, ps.
    span_ps: [i64; 2],
    /// Bins with counts that lie within it, and those of them that agree.
    compared: u64,
    agreed: u64,
}

impl Stretch {
    fn trusted(&self) -> bool {
        2 * self.agreed > self.compared
    }
}

/// Times of a bin's tags for each column of the counts, ps.
type Times = Vec<Option<Vec<i64>>>;

/// Result of the comparison of a bin's tags with its counts.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Found {
    /// Same number of tags as counts, or none of either.
    Agree,
    /// Another number, on some channel.
    Differ,
    /// The stretch ends before the bin, or begins after it, or within it.
    Beyond,
    /// The counter says that it did not time all of them.
    Incomplete,
}

/// Summary of what became of a counter's tags.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct TagSummary {
    /// Records in the file.
    pub records: u64,
    /// Bytes of a torn record at its end, and records of zeros there, which were left out.
    pub cut: [u64; 2],
    /// Stretches of one clock, and those of them that are not the counts'.
    pub stretches: [usize; 2],
    /// Bins whose tags are as many as their counts: they are linearised by their tags.
    pub used: u64,
    /// Those that agree in a stretch that is not the counts'.
    pub distrusted: u64,
    /// Bins whose tags are not.
    pub differ: u64,
    /// Bins with counts beyond what the tags cover.
    pub beyond: u64,
    /// Bins of which the counter says that it did not time all.
    pub incomplete: u64,
    /// Channels of which there is no tag.
    pub without: Vec<String>,
}

/// A counter's file of tags.
#[derive(Debug)]
pub struct Tags {
    path: PathBuf,
    file: TagFile,
    recovered: Recovered,
    /// The input of each column of the counts, where the manifest tells and where tags of it are.
    inputs: Vec<Option<i32>>,
    without: Vec<String>,
    stretches: Vec<Stretch>,
}

impl Tags {
    /// Opens a counter's tags and finds their stretches; `None` without a file. What a person should hear of goes to `warnings`.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn open(
        session: &Session,
        counter: &str,
        columns: &[String],
        warnings: &mut Vec<String>,
    ) -> Result<Option<Self>, FileError> {
        let device = session.manifest().devices.iter().find(|device| device.name == counter);
        let asked = device.is_some_and(|device| device.raw_tags);
        let Some(path) = session.tags(counter)? else {
            if asked {
                warnings.push(format!(
                    "counter {counter}: its raw tags were recorded, and tags/{counter}.tags is not there: bins are linearised whole"
                ));
            }
            return Ok(None);
        };
        let input = |name: &String| {
            let device = device?;
            let at = device.channels.iter().position(|channel| channel == name)?;
            device.inputs.get(at).copied()
        };
        let mut inputs: Vec<Option<i32>> = columns.iter().map(input).collect();
        if inputs.iter().all(Option::is_none) {
            warnings.push(format!(
                "counter {counter}: the session does not say which input each channel is on (`inputs`): its raw tags are not used"
            ));
            return Ok(None);
        }
        // Without its tags a night is still a night.
        let read = TagFile::recover(&path).and_then(|(file, recovered)| {
            let found = stretches(&file)?;
            Ok((file, recovered, found))
        });
        let (file, recovered, (stretches, seen)) = match read {
            Ok(read) => read,
            Err(error) => {
                warnings.push(format!("counter {counter}: {error}: bins are linearised whole"));
                return Ok(None);
            }
        };
        let mut without = Vec::new();
        for (input, name) in inputs.iter_mut().zip(columns) {
            if input.is_none_or(|input| !seen.contains(&input)) {
                *input = None;
                without.push(name.clone());
            }
        }
        if inputs.iter().all(Option::is_none) {
            warnings.push(format!(
                "counter {counter}: {} has no tag of its channels: bins are linearised whole",
                path.display()
            ));
            return Ok(None);
        }
        Ok(Some(Self { path, file, recovered, inputs, without, stretches }))
    }

    /// A run over the bins; before [`judge`](Self::judge) none is trusted.
    pub fn run(&self) -> Run<'_> {
        Run {
            tags: self,
            stretch: 0,
            ready: Vec::new(),
            taken: 0,
            next: self.stretches.first().map_or(0, |stretch| stretch.records.start),
            before_ps: i64::MIN,
            found: vec![[0; 2]; self.stretches.len()],
            summary: TagSummary {
                records: self.recovered.records,
                cut: [self.recovered.torn_bytes, self.recovered.zero_records],
                without: self.without.clone(),
                ..TagSummary::default()
            },
        }
    }

    /// Takes over what a run over all bins has found of the stretches.
    pub fn judge(&mut self, found: Vec<[u64; 2]>) {
        for (stretch, [compared, agreed]) in self.stretches.iter_mut().zip(found) {
            (stretch.compared, stretch.agreed) = (compared, agreed);
        }
    }

    /// Returns the warnings about the tags for the user.
    pub fn warnings(&self, counter: &str, summary: &TagSummary) -> Vec<String> {
        let mut warnings = Vec::new();
        let mut say = |text: String| warnings.push(format!("counter {counter}: {text}"));
        let path = self.path.display();
        let [torn, zeros] = summary.cut;
        if torn > 0 || zeros > 0 {
            say(format!(
                "{path} was cut: {torn} bytes of a torn record and {zeros} records of zeros at its end are left out"
            ));
        }
        for name in &summary.without {
            say(format!("{path} has no tag of channel {name}: its bins are linearised whole"));
        }
        for stretch in self.stretches.iter().filter(|stretch| !stretch.trusted()) {
            let Stretch { records, span_ps: [from, to], compared, agreed } = stretch;
            if *compared > 0 {
                say(format!(
                    "records {} to {} of {path} ({:.3} to {:.3} s of its clock) agree with the counts in {agreed} of {compared} bins: they are not of these bins, and are not used",
                    records.start,
                    records.end,
                    *from as f64 * 1e-12,
                    *to as f64 * 1e-12
                ));
            }
        }
        for (bins, what) in [
            (summary.differ, "with more or fewer tags than counts"),
            (summary.beyond, "with counts before the first tag or after the last"),
        ] {
            if bins > 0 {
                say(format!("{bins} bins {what}: they are linearised whole"));
            }
        }
        warnings
    }
}

/// The stretches of a file, and the inputs that its tags are on.
fn stretches(file: &TagFile) -> Result<(Vec<Stretch>, BTreeSet<i32>), FileError> {
    let mut stretches: Vec<Stretch> = Vec::new();
    let mut inputs = BTreeSet::new();
    let (mut number, mut anew) = (0, true);
    file.for_each(0..file.len(), |some| {
        for tag in some.iter() {
            let kind = tag.kind();
            if kind == Some(TagKind::TimeTag) {
                inputs.insert(tag.channel);
            }
            // What a record of no known kind says of the clock is not known.
            anew |= matches!(kind, Some(TagKind::Error) | None);
            match stretches.last_mut().filter(|last| !anew && tag.time_ps >= last.span_ps[1]) {
                Some(last) => {
                    last.records.end = number + 1;
                    last.span_ps[1] = tag.time_ps;
                }
                None => stretches.push(Stretch {
                    records: number..number + 1,
                    span_ps: [tag.time_ps; 2],
                    compared: 0,
                    agreed: 0,
                }),
            }
            anew = matches!(kind, Some(TagKind::Error) | None);
            number += 1;
        }
        Ok::<_, FileError>(())
    })?;
    Ok((stretches, inputs))
}

/// Bins in their order, each with its tags.
#[derive(Debug)]
pub struct Run<'a> {
    tags: &'a Tags,
    /// The present stretch.
    stretch: usize,
    /// Tags of the stretch that were read, how many of them lie before the last bin, and the first record that was not read.
    ready: Vec<Tag>,
    taken: usize,
    next: u64,
    /// Begin of the last bin.
    before_ps: i64,
    /// Numbers of bins that were compared in each stretch, and of those that agree.
    found: Vec<[u64; 2]>,
    summary: TagSummary,
}

impl Run<'_> {
    /// A bin with its tags, where its stretch is trusted and they are as many as its counts.
    ///
    /// # Errors
    /// A file that cannot be read any more.
    pub fn bin(&mut self, record: CountRecord) -> Result<Bin, FileError> {
        let (found, tags_ps) = self.tags_of(&record)?;
        let trusted = self.tags.stretches.get(self.stretch).is_some_and(Stretch::trusted);
        match found {
            Found::Agree if trusted => self.summary.used += 1,
            Found::Agree => {
                self.summary.distrusted += u64::from(record.counts.iter().any(|n| *n > 0))
            }
            Found::Differ => self.summary.differ += 1,
            Found::Beyond => self.summary.beyond += 1,
            Found::Incomplete => self.summary.incomplete += 1,
        }
        // Of channels that do not agree the reduction takes no tags.
        let used = trusted && found != Found::Incomplete;
        Ok(Bin { record, tags_ps: if used { tags_ps } else { Vec::new() } })
    }

    /// Returns the summary, and for each stretch the bins that were compared and those that agree.
    pub fn finish(mut self) -> (TagSummary, Vec<[u64; 2]>) {
        let unused = self.tags.stretches.iter().filter(|stretch| !stretch.trusted()).count();
        self.summary.stretches = [self.tags.stretches.len(), unused];
        (self.summary, self.found)
    }

    fn tags_of(&mut self, record: &CountRecord) -> Result<(Found, Times), FileError> {
        // A clock that began anew is that of a later stretch.
        let anew = record.start_ps < self.before_ps;
        self.before_ps = record.start_ps;
        let incomplete =
            record.flags.intersects(CountFlags::ERROR | CountFlags::OVERFLOW | CountFlags::MISSED)
                || record.missed.iter().any(|missed| *missed > 0);
        let present = self.stretch;
        if anew {
            self.go_to(present, record.start_ps)?;
        }
        let own = self.collect(record)?;
        if incomplete {
            return Ok((Found::Incomplete, own));
        }
        let mut found = self.compare(record, &own);
        if anew || !matches!(found, Found::Agree) {
            for later in (present + 1..self.tags.stretches.len()).take(TRIED) {
                self.go_to(later, record.start_ps)?;
                let tags = self.collect(record)?;
                if self.compare(record, &tags) == Found::Agree
                    && tags.iter().flatten().any(|tags| !tags.is_empty())
                {
                    self.judged(record, &Found::Agree);
                    return Ok((Found::Agree, tags));
                }
            }
            if self.stretch != present {
                self.go_to(present, record.start_ps)?;
                let again = self.collect(record)?;
                found = self.compare(record, &again);
            }
        }
        self.judged(record, &found);
        Ok((found, own))
    }

    /// Notes for the present stretch whether a bin within it agrees.
    fn judged(&mut self, record: &CountRecord, found: &Found) {
        let Some(stretch) = self.tags.stretches.get(self.stretch) else { return };
        let within = stretch.span_ps[0] <= record.start_ps
            && record.start_ps.saturating_add(record.length_ps) <= stretch.span_ps[1];
        let counts = record.counts.iter().zip(&self.tags.inputs);
        let counted: u64 =
            counts.filter(|(_, input)| input.is_some()).map(|(counts, _)| *counts).sum();
        if within && counted > 0 {
            self.found[self.stretch][0] += 1;
            self.found[self.stretch][1] += u64::from(*found == Found::Agree);
        }
    }

    fn compare(&self, record: &CountRecord, tags: &[Option<Vec<i64>>]) -> Found {
        let channels = record.counts.iter().zip(tags);
        let differ = channels.filter_map(|(counts, tags)| Some((*counts, tags.as_ref()?)));
        if differ.clone().all(|(counts, tags)| tags.len() as u64 == counts) {
            return Found::Agree;
        }
        let end_ps = record.start_ps.saturating_add(record.length_ps);
        match self.tags.stretches.get(self.stretch) {
            Some(stretch)
                if stretch.span_ps[0] <= record.start_ps && end_ps <= stretch.span_ps[1] =>
            {
                Found::Differ
            }
            _ => Found::Beyond,
        }
    }

    /// Goes to the first tag of a stretch that is not before a time.
    fn go_to(&mut self, stretch: usize, from_ps: i64) -> Result<(), FileError> {
        let Some(Stretch { records, .. }) = self.tags.stretches.get(stretch) else { return Ok(()) };
        let (mut low, mut high) = (records.start, records.end);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.tags.file.get(middle)?.time_ps < from_ps {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        (self.stretch, self.next) = (stretch, low);
        self.ready.clear();
        self.taken = 0;
        Ok(())
    }

    /// The tags of a bin in the present stretch, by column; the place moves on to behind them.
    fn collect(&mut self, record: &CountRecord) -> Result<Times, FileError> {
        let mut tags: Times =
            self.tags.inputs.iter().map(|input| input.map(|_| Vec::new())).collect();
        let end_ps = record.start_ps.saturating_add(record.length_ps);
        while let Some(tag) = self.peek()? {
            if tag.time_ps >= end_ps {
                break;
            }
            self.taken += 1;
            if tag.time_ps < record.start_ps || tag.kind() != Some(TagKind::TimeTag) {
                continue;
            }
            for (input, tags) in self.tags.inputs.iter().zip(&mut tags) {
                if let Some(tags) = tags.as_mut().filter(|_| *input == Some(tag.channel)) {
                    tags.push(tag.time_ps);
                }
            }
        }
        Ok(tags)
    }

    /// The next tag of the present stretch.
    fn peek(&mut self) -> Result<Option<Tag>, FileError> {
        if self.taken == self.ready.len() {
            self.ready.clear();
            self.taken = 0;
            let end = self.tags.stretches.get(self.stretch).map_or(0, |s| s.records.end);
            let to = end.min(self.next.saturating_add(READ));
            if self.next < to {
                let ready = &mut self.ready;
                self.tags.file.for_each(self.next..to, |some| {
                    ready.extend(some.iter());
                    Ok::<_, FileError>(())
                })?;
                self.next = to;
            }
        }
        Ok(self.ready.get(self.taken).copied())
    }
}
