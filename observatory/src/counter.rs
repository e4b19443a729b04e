//! A counter's thread: finished bins, each once.

use super::camera::seconds;
use super::disk::Disk;
use super::plan::CounterPlan;
use super::tags::{Loss, planned};
use super::worker::{READY, SOON, Worker};
use std::time::Duration;
use sunglint_drivers::device::{DeviceError, PhotonCounter, TagSink};
use sunglint_drivers::tags::Tag;
use sunglint_formats::{CountFlags, CountRecord};

/// How much longer than its length a bin may take.
const BIN: Duration = Duration::from_secs(10);
/// Bins are asked for in stretches of about that long, s.
const STRETCH_S: f64 = 0.1;

/// A counter at work.
#[derive(Debug)]
pub struct CounterWork {
    plan: CounterPlan,
    names: Vec<String>,
    /// Whether there were bins before the counter was lost: its next one begins after a gap.
    gap_before: bool,
    taken: bool,
}

impl CounterWork {
    /// A counter as planned; `taken`: whether the session has bins of it from before.
    pub fn new(plan: CounterPlan, taken: bool) -> Self {
        let names = plan.channel_names();
        Self { plan, names, gap_before: false, taken }
    }

    /// Opens the counter and counts until the night is over.
    pub fn run(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        let mut counter = worker.opener.counter(&self.plan, &worker.within(READY))?;
        let columns = self.columns(counter.as_ref()).map_err(|error| worker.setting(error))?;
        self.prepare(counter.as_mut(), &columns, worker).map_err(|error| worker.setting(error))?;
        worker.opened(counter.as_mut())?;
        let bin_s = self.plan.bin_s.get();
        let (bin_ps, soon) = ((bin_s * 1e12).round() as i64, worker.within(SOON));
        if self.plan.raw_tags {
            let sink = self.sink(worker);
            counter.start_with_tags(bin_ps, sink, &soon)?;
        } else {
            counter.start(bin_ps, &soon)?;
        }
        let bins = ((STRETCH_S / bin_s) as usize).clamp(1, 10_000);
        let stretch = seconds(bins as f64 * bin_s);
        let most = BIN.saturating_add(stretch);
        self.gap_before = self.taken;
        let mut first = true;
        while !worker.is_over() {
            let (records, error) = match counter.read(bins, &worker.within_of(most, stretch)) {
                Ok(records) => (records, None),
                Err(interrupted) => (interrupted.done, Some(*interrupted.error)),
            };
            if !records.is_empty() {
                if std::mem::take(&mut first) || worker.lost_at.is_some() {
                    worker.works();
                }
                self.hand_over(records, &columns, worker);
            }
            match error {
                // What Ctrl-C ends is no failure.
                Some(_) if worker.is_over() => break,
                Some(error) => return Err(error),
                None => {}
            }
        }
        // A counter that cannot be stopped is left counting: what it gave is good all the same.
        let _ = counter.stop(&worker.even_so(SOON));
        Ok(())
    }

    /// Where its tags go. After a loss of the counter its clock may be another: an error record says so.
    fn sink(&self, worker: &Worker) -> TagSink {
        let inputs = self.plan.inputs();
        let mut way =
            TagWay { counter: worker.name.clone(), disk: worker.disk.clone(), loss: None };
        let mut anew = self.taken;
        TagSink::new(move |records| {
            let mut records = planned(records, &inputs);
            if let Some(first) = records.first().filter(|_| std::mem::take(&mut anew)) {
                records.insert(0, Tag::error(Tag::from_bytes(first).time_ps).to_bytes());
            }
            if !records.is_empty() {
                way.loss = way.disk.tags(&way.counter, way.loss.take(), records);
            }
        })
    }

    /// For each channel of the plan the counter's own.
    fn columns(&self, counter: &dyn PhotonCounter) -> Result<Vec<usize>, DeviceError> {
        let known = counter.channels();
        let place = |name: &String| {
            let input = self.plan.channels.get(name).copied().unwrap_or(0);
            let by_input = format!("c{input}");
            let find = |wanted: &str| known.iter().position(|known| known == wanted);
            find(name).or_else(|| find(&by_input)).ok_or_else(|| DeviceError::Unknown {
                name: "channel",
                asked: format!("{name} (input {input})"),
                known: known.join(", "),
            })
        };
        self.names.iter().map(place).collect()
    }

    fn prepare(
        &self,
        counter: &mut dyn PhotonCounter,
        columns: &[usize],
        worker: &Worker,
    ) -> Result<(), DeviceError> {
        for (name, &column) in self.names.iter().zip(columns) {
            if let Some(level) = self.plan.trigger_level_v.get(name) {
                counter.set_trigger_level_v(column, level.get(), &worker.within(SOON))?;
            }
            if let Some(delay) = self.plan.input_delay_ps.get(name) {
                counter.set_input_delay_ps(column, *delay, &worker.within(SOON))?;
            }
            if let Some(dead_time) = self.plan.dead_time_ps.get(name) {
                counter.set_dead_time_ps(column, *dead_time, &worker.within(SOON))?;
            }
        }
        Ok(())
    }

    fn hand_over(&mut self, records: Vec<CountRecord>, columns: &[usize], worker: &Worker) {
        let of =
            |values: &[u64]| columns.iter().map(|&i| values.get(i).copied().unwrap_or(0)).collect();
        let mut records: Vec<CountRecord> = records
            .into_iter()
            .map(|record| CountRecord {
                counts: of(&record.counts),
                missed: of(&record.missed),
                ..record
            })
            .collect();
        if let Some(first) = records.first_mut().filter(|_| std::mem::take(&mut self.gap_before)) {
            first.flags |= CountFlags::GAP;
        }
        self.taken = true;
        worker.status.counts(&worker.name, &self.names, &records);
        if let Some(last) = records.last() {
            let length =
                hifitime::Duration::from_total_nanoseconds(i128::from(last.length_ps) / 1000);
            worker.reached(last.start + length);
        }
        worker.disk.counts(&worker.name, records);
    }
}

/// The way of a counter's tags to the disk.
struct TagWay {
    counter: String,
    disk: Disk,
    /// Last loss of tags, while it is not reported yet.
    loss: Option<Loss>,
}

impl Drop for TagWay {
    fn drop(&mut self) {
        if let Some(loss) = self.loss.take() {
            self.disk.tags_lost(&self.counter, loss);
        }
    }
}
