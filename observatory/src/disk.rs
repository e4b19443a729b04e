//! The one thread that writes: devices hand over what they have and go on.

use super::live::LiveState;
use super::room::{Bulk, Room};
use super::status::Status;
use super::tags::{Loss, TagBudget};
use hifitime::Epoch;
use std::collections::HashMap;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};
use sunglint_drivers::tags::RECORD_BYTES;
use sunglint_formats::session::{Ended, SessionWriter, What};
use sunglint_formats::{CountRecord, EncodeError, Frame};

/// Messages that wait at most; each holds at most the bins of a moment.
const MESSAGES: usize = 1024;
/// Pixels that wait at most, bytes.
const PIXELS: u64 = 64 << 20;
/// Bytes of a frame's header, and of the rest of its last block.
const HEADER: u64 = 3 * 2880;
/// How often the writer looks at its clock.
const POLL: Duration = Duration::from_millis(50);

/// Message to the writer, with the data to be written.
enum Message {
    Counts(String, Vec<CountRecord>),
    Frame(String, u64, Arc<Frame>),
    Event(Epoch, What),
    Tags(String, Option<Loss>, Vec<[u8; RECORD_BYTES]>),
}

/// Takes what is to be written, from any thread. Where the disk is slower than the devices, it holds them up once a thousand
/// messages or 64 MiB of pixels wait, so that memory stays flat.
#[derive(Debug, Clone)]
pub struct Disk {
    sender: SyncSender<Message>,
    pixels: Arc<Pixels>,
    tag_budget: Arc<TagBudget>,
    live: bool,
    /// Who looks on.
    watcher: Option<Arc<LiveState>>,
}

impl std::fmt::Debug for Message {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Counts(name, records) => write!(f, "{} bins of {name}", records.len()),
            Self::Frame(name, number, _) => write!(f, "frame {number} of {name}"),
            Self::Tags(name, loss, tags) => {
                write!(f, "{} tags of {name} after {loss:?}", tags.len())
            }
            Self::Event(utc, what) => write!(f, "{utc} {what:?}"),
        }
    }
}

/// Bytes of pixels on their way.
#[derive(Debug, Default)]
struct Pixels {
    waiting: Mutex<u64>,
    fewer: Condvar,
}

impl Pixels {
    fn add(&self, bytes: u64) {
        let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        // One frame always passes, however large it is.
        let full = |waiting: &mut u64| *waiting > 0 && *waiting + bytes > PIXELS;
        let waiting = self.fewer.wait_while(waiting, full);
        *waiting.unwrap_or_else(PoisonError::into_inner) += bytes;
    }

    fn take(&self, bytes: u64) {
        *self.waiting.lock().unwrap_or_else(PoisonError::into_inner) -= bytes;
        self.fewer.notify_all();
    }
}

fn bytes_of(frame: &Frame) -> u64 {
    2 * frame.pixels.len() as u64
}

/// The writer's thread, and what hands over to it.
///
/// Where devices do not wait (`live`) tags that find no room are lost; a recording that is played as fast as the machine can waits for it.
pub fn start(
    writer: SessionWriter,
    status: Arc<Status>,
    live: bool,
    watcher: Option<Arc<LiveState>>,
    room: Room,
) -> std::io::Result<(Disk, std::thread::JoinHandle<Writing>)> {
    let (sender, receiver) = sync_channel(MESSAGES);
    let pixels = Arc::new(Pixels::default());
    let tag_budget = Arc::new(TagBudget::default());
    let disk =
        Disk { sender, pixels: pixels.clone(), tag_budget: tag_budget.clone(), live, watcher };
    let writing = Writing {
        writer,
        status,
        pixels,
        tag_budget,
        tags_lost: HashMap::new(),
        room,
        left_out: HashMap::new(),
    };
    let thread = std::thread::Builder::new().name("disk".into());
    let handle = thread.spawn(move || writing.run(&receiver))?;
    Ok((disk, handle))
}

impl Disk {
    /// Hands over bins.
    pub fn counts(&self, counter: &str, records: Vec<CountRecord>) {
        if let Some(watcher) = &self.watcher {
            watcher.counts(counter, &records);
        }
        self.send(Message::Counts(counter.to_owned(), records));
    }

    /// Hands over a frame.
    pub fn frame(&self, camera: &str, number: u64, frame: Frame) {
        let frame = Arc::new(frame);
        if let Some(watcher) = &self.watcher {
            watcher.frame(camera, number, &frame);
        }
        self.pixels.add(bytes_of(&frame));
        self.send(Message::Frame(camera.to_owned(), number, frame));
    }

    /// Shows a frame that is not recorded to those who look on.
    pub fn look(&self, camera: &str, frame: Frame) {
        if let Some(watcher) = &self.watcher {
            watcher.frame(camera, 0, &Arc::new(frame));
        }
    }

    /// Hands over tags; of a live device without ever waiting: where there is no room they are lost. `loss` is what was lost before and is not told yet;
    /// the result is what is lost now.
    pub fn tags(
        &self,
        counter: &str,
        loss: Option<Loss>,
        records: Vec<[u8; RECORD_BYTES]>,
    ) -> Option<Loss> {
        let bytes = records.as_flattened().len() as u64;
        if !self.live {
            self.tag_budget.add(bytes);
            self.send(Message::Tags(counter.to_owned(), loss, records));
            return None;
        }
        if !self.tag_budget.take(bytes, loss.is_some()) {
            return Loss::and(loss, Loss::of(&records));
        }
        match self.sender.try_send(Message::Tags(counter.to_owned(), loss, records)) {
            Err(TrySendError::Full(Message::Tags(_, loss, records))) => {
                self.tag_budget.give(bytes);
                Loss::and(loss, Loss::of(&records))
            }
            _ => None,
        }
    }

    /// Tells of tags that were lost and that none follow.
    pub fn tags_lost(&self, counter: &str, loss: Loss) {
        self.send(Message::Tags(counter.to_owned(), Some(loss), vec![]));
    }

    /// Hands over an event.
    pub fn event(&self, utc: Epoch, what: What) {
        if let Some(watcher) = &self.watcher {
            watcher.event(utc, &what);
        }
        self.send(Message::Event(utc, what));
    }

    fn send(&self, message: Message) {
        // The writer ends after all who send; where it has ended before, by a panic, its thread's result says so.
        let _ = self.sender.send(message);
    }
}

/// The writer at work.
#[derive(Debug)]
pub struct Writing {
    writer: SessionWriter,
    status: Arc<Status>,
    pixels: Arc<Pixels>,
    tag_budget: Arc<TagBudget>,
    /// Tags that found no room on the disk, and that the file does not tell of yet.
    tags_lost: HashMap<String, Loss>,
    /// Room of the disk.
    room: Room,
    /// What finds no room, with how many frames or tags by now.
    left_out: HashMap<String, u64>,
}

impl Writing {
    fn run(mut self, receiver: &Receiver<Message>) -> Self {
        let start = Instant::now();
        let mut looked = Duration::ZERO;
        loop {
            match receiver.recv_timeout(POLL) {
                Ok(message) => self.write(message),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self,
            }
            let now = start.elapsed();
            if now.saturating_sub(looked) >= POLL {
                looked = now;
                for fault in self.writer.tick(now, self.status.utc()) {
                    self.status.disk_fault(&fault);
                }
                self.status.set_lost(self.writer.lost(), self.writer.is_failing());
            }
        }
    }

    fn write(&mut self, message: Message) {
        let failed = match message {
            Message::Counts(counter, records) => {
                // One that cannot be written takes no other with it.
                let errors = records.iter().filter_map(|r| self.writer.count(&counter, r).err());
                errors.fold(None, |first, error| first.or(Some(error))).map(|e| (counter, e))
            }
            Message::Frame(camera, number, frame) => {
                let bytes = bytes_of(&frame);
                let found = self.room.take(Bulk::Frame, bytes + HEADER, self.status.utc());
                if let Err(kept) = found {
                    self.pixels.take(bytes);
                    self.leave_out(&format!("frames of {camera}"), 1, kept);
                    self.writer.lose_frame(&camera, number);
                    return;
                }
                self.has_room(&format!("frames of {camera}"));
                let written = self.writer.frame(&camera, number, &frame);
                self.pixels.take(bytes);
                match written {
                    Ok(fault) => {
                        if let Some(fault) = fault {
                            self.status.disk_fault(&fault);
                        }
                        None
                    }
                    Err(error) => Some((camera, error)),
                }
            }
            Message::Tags(counter, loss, records) => {
                self.tag_budget.give(records.as_flattened().len() as u64);
                self.write_tags(&counter, loss, &records).err().map(|error| (counter, error))
            }
            Message::Event(utc, what) => {
                self.writer.event(utc, what);
                None
            }
        };
        // What a device delivers and the format cannot hold.
        if let Some((about, error)) = failed {
            let error = error.to_string();
            self.status.unwritable(&about, &error);
            self.writer.event(self.status.utc(), What::Error { about, error });
        }
    }

    /// Data that are left out so that others find room: told once, and counted.
    fn leave_out(&mut self, what: &str, count: u64, (free, kept): (u64, u64)) {
        let so_far = self.left_out.entry(what.to_owned()).or_insert(0);
        *so_far += count;
        if *so_far > count {
            return;
        }
        let [free, kept] = [free, kept].map(|bytes| 1e-6 * bytes as f64);
        let error = format!(
            "{what} are left out from here on: {free:.1} MB are free, {kept:.1} MB are kept for what comes first (the log and bins, then frames, then tags)"
        );
        self.status.say(error.clone());
        self.writer.event(self.status.utc(), What::Error { about: what.to_owned(), error });
    }

    /// There is room for them again.
    fn has_room(&mut self, about: &str) {
        if let Some(lost) = self.left_out.remove(about) {
            self.status.say(format!("{about} find room again; {lost} were left out"));
            let what = What::Recovered { about: about.to_owned(), lost };
            self.writer.event(self.status.utc(), what);
        }
    }

    fn write_tags(
        &mut self,
        counter: &str,
        loss: Option<Loss>,
        records: &[[u8; RECORD_BYTES]],
    ) -> Result<(), EncodeError> {
        let utc = self.status.utc();
        if let Some(loss) = loss {
            self.writer.lose_tags(utc, counter, loss.records)?;
            let text = format!("{counter}: {} tags lost: the disk is too slow", loss.records);
            self.status.say(text);
        }
        let before = Loss::and(self.tags_lost.remove(counter), loss);
        let bytes = records.as_flattened().len() as u64;
        let about = format!("tags of {counter}");
        if let Err(kept) = self.room.take(Bulk::Tags, bytes, utc) {
            self.leave_out(&about, records.len() as u64, kept);
            self.writer.lose_counted_tags(counter, records.len() as u64)?;
            if let Some(lost) = Loss::and(before, Loss::of(records)) {
                self.tags_lost.insert(counter.to_owned(), lost);
            }
            return Ok(());
        }
        self.has_room(&about);
        let marks = before.map(Loss::marks);
        let mut bytes = marks.as_ref().map_or(&[][..], |marks| marks.as_flattened()).to_vec();
        bytes.extend_from_slice(records.as_flattened());
        if !self.writer.tags(utc, counter, &bytes)?
            && let Some(lost) = Loss::and(before, Loss::of(records))
        {
            self.tags_lost.insert(counter.to_owned(), lost);
        }
        Ok(())
    }

    /// Ends the session.
    pub fn finish(self, utc: Epoch, reason: &str) -> Ended {
        self.writer.finish(utc, reason)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_drivers::tags::{Tag, TagKind};

    /// 65,536 photons, a MiB, a microsecond apart.
    fn a_mebibyte(number: i64) -> Vec<[u8; RECORD_BYTES]> {
        let first = number << 16;
        (first..first + (1 << 16)).map(|k| Tag::photon(1, 1_000_000 * k).to_bytes()).collect()
    }

    /// The same disk before a recording that is played as fast as it can: it waits. Truth: by hand: 80 MiB at a disk that begins late and takes one at a time are all handed on, in order, and
    /// the room that they took is free again.
    #[test]
    fn a_recording_waits_for_room() {
        let (sender, receiver) = sync_channel(2);
        let tag_budget = Arc::new(TagBudget::default());
        let disk = Disk {
            sender,
            pixels: Arc::default(),
            tag_budget: tag_budget.clone(),
            live: false,
            watcher: None,
        };
        let writing = std::thread::spawn(move || {
            std::thread::sleep(POLL);
            let take = |message: Message| match message {
                Message::Tags(_, None, records) => {
                    tag_budget.give(records.as_flattened().len() as u64);
                    Tag::from_bytes(&records[0]).time_ps
                }
                other => panic!("{other:?}"),
            };
            let times: Vec<i64> = receiver.iter().map(take).collect();
            // All of it is free: as much as fits at all.
            assert!(tag_budget.take(64 << 20, false));
            times
        });
        for number in 0..80 {
            assert_eq!(disk.tags("tagger", None, a_mebibyte(number)), None);
        }
        drop(disk);
        let expected: Vec<i64> = (0..80).map(|number| 1_000_000 * (number << 16)).collect();
        assert_eq!(writing.join().unwrap(), expected);
    }

    /// A disk that does not write for a while. Truth: by hand: 64 MiB wait, what comes then is lost in one piece until half of that is free, bins never wait for tags,
    /// and each tag is either handed on or within the span of a loss that is told.
    #[test]
    fn tags_that_find_no_room_are_counted_and_told() {
        let (sender, receiver) = sync_channel(MESSAGES);
        let tag_budget = Arc::new(TagBudget::default());
        let disk = Disk {
            sender,
            pixels: Arc::default(),
            tag_budget: tag_budget.clone(),
            live: true,
            watcher: None,
        };
        let mut loss = None;
        for number in 0..80 {
            loss = disk.tags("tagger", loss, a_mebibyte(number));
            disk.counts("tagger", vec![]);
        }
        let span_ps = [64 << 16, (80 << 16) - 1].map(|k| 1_000_000 * k);
        assert_eq!(loss, Some(Loss { span_ps, records: 16 << 16 }));
        let take = |n: usize| -> Vec<Message> {
            let mut taken = Vec::new();
            while taken.iter().filter(|m| matches!(m, Message::Tags(..))).count() < n {
                let message = receiver.try_recv().unwrap();
                if let Message::Tags(_, _, records) = &message {
                    tag_budget.give(records.as_flattened().len() as u64);
                }
                taken.push(message);
            }
            taken
        };
        // Not before half is free.
        take(32);
        loss = disk.tags("tagger", loss, a_mebibyte(80));
        assert_eq!(loss.map(|l| l.records), Some(17 << 16));
        take(1);
        assert_eq!(disk.tags("tagger", loss, a_mebibyte(81)), None);
        let last = take(32).pop().unwrap();
        let Message::Tags(_, Some(told), records) = last else { panic!("{last:?}") };
        assert_eq!(told, loss.unwrap());
        let marks = told.marks().map(|mark| Tag::from_bytes(&mark));
        assert_eq!(
            marks.map(|m| m.kind()),
            [Some(TagKind::OverflowBegin), Some(TagKind::OverflowEnd)]
        );
        assert!(marks[1].time_ps < Tag::from_bytes(&records[0]).time_ps);
    }
}
