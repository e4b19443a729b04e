//! A camera's video stream.

use super::camera::{BLOB, Camera, DEVICE};
use super::client::{Wanted, declined, hear};
use super::image::from_stream;
use super::property::{Blob, Event, State};
use super::session::check_range;
use crate::clock::Deadline;
use crate::device::{DeviceError, Interrupted, Window};
use crate::transport::Bytes;
use std::ops::ControlFlow;
use sunglint_formats::Frame;

const VIDEO: &str = "CCD_VIDEO_STREAM";
const EXPOSURE: (&str, &str) = ("STREAMING_EXPOSURE", "STREAMING_EXPOSURE_VALUE");
const ON: Wanted<'_> = Wanted::Switches(&[("STREAM_ON", true), ("STREAM_OFF", false)]);
const OFF: Wanted<'_> = Wanted::Switches(&[("STREAM_ON", false), ("STREAM_OFF", true)]);

impl<T: Bytes> Camera<T> {
    pub(super) fn stream_frames(
        &mut self,
        exposure_s: f64,
        take: &mut dyn FnMut(Frame) -> ControlFlow<()>,
        deadline: &Deadline,
    ) -> Result<u64, Interrupted<u64>> {
        self.start_stream(exposure_s, deadline).map_err(|error| Interrupted::new(0, error))?;
        let mut count = 0;
        let result = loop {
            match self.next_frame(exposure_s, deadline) {
                Ok(frame) => {
                    count += 1;
                    if take(frame).is_break() {
                        break self.end_stream(deadline);
                    }
                }
                Err(error) => break Err(self.stop_after(error, VIDEO, OFF, deadline)),
            }
        };
        // The window of exposures was put aside for the stream's own.
        let restored = self.restore(deadline);
        match result.and(restored) {
            Ok(()) => Ok(count),
            Err(error) => Err(Interrupted::new(count, error)),
        }
    }

    fn whole(&self) -> Window {
        use crate::device::Camera as _;
        Window { origin_px: [0, 0], size_px: self.sensor_px(), binning: [1, 1] }
    }

    /// A stream has a window of its own, which lies within that of exposures: with that cut, 1.9.9 sends nothing at all.
    fn start_stream(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<(), DeviceError> {
        self.require_idle()?;
        self.session.require("CONNECTION")?;
        if self.session.property(VIDEO).is_none() {
            let reason = "it has no video stream";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        if self.window.binning != [1, 1] {
            let reason = "a stream is not binned: set a window with a binning of 1 first";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let (name, member) = EXPOSURE;
        check_range("exposure, s", exposure_s, self.session.require(name)?.range(member))?;
        let whole = self.whole();
        if self.window != whole {
            self.set_frame("CCD_FRAME", &whole, deadline)?;
        }
        let window = self.window;
        if self.session.property("CCD_STREAM_FRAME").is_some() {
            self.set_frame("CCD_STREAM_FRAME", &window, deadline)?;
        } else if window != whole {
            let reason = "its stream has no window of its own";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let soon = deadline.at_most(self.settings.session.answer_within);
        let after = self.session.change(name, Wanted::Numbers(&[(member, exposure_s)]), &soon)?;
        match after.number(member) {
            Some(got) if (got - exposure_s).abs() <= 1e-6 * exposure_s => {}
            got => {
                let (asked, got) = (exposure_s.to_string(), format!("{got:?}"));
                let name = "exposure of a stream, s";
                return Err(DeviceError::NotTaken { device: DEVICE, name, asked, got });
            }
        }
        let device = self.session.device.clone();
        self.session.client.set(&device, VIDEO, ON, deadline)
    }

    fn next_frame(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<Frame, DeviceError> {
        let taken = self.taken();
        let device = self.session.device.clone();
        let mut said = Vec::new();
        let client = &mut self.session.client;
        let blob: Blob =
            client.wait(&device, "a frame of the stream", deadline, |_, event| match event {
                Event::Message { text, .. } => {
                    hear(&mut said, text);
                    None
                }
                Event::Changed(place, State::Alert)
                    if place.device == device && place.name == VIDEO =>
                {
                    Some(Err(declined(DEVICE, "to stream".into(), &said)))
                }
                Event::Blob(place, blob) if place.device == device && place.name == BLOB => {
                    Some(Ok(blob))
                }
                Event::Damaged(place, what) if place.device == device && place.name == BLOB => {
                    Some(Err(DeviceError::Protocol { device: DEVICE, reason: what }))
                }
                _ => None,
            })?;
        let arrived = (self.settings.utc)();
        from_stream(&blob, &taken, arrived, exposure_s, self.temperature_c())
            .map_err(|reason| self.session.protocol(reason))
    }

    fn end_stream(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let grace = deadline.grace(self.settings.abort_within);
        self.session.change(VIDEO, OFF, &grace).map(drop)
    }

    fn restore(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let window = self.window;
        if window == self.whole() || self.require_idle().is_err() {
            return Ok(());
        }
        let grace = deadline.grace(self.settings.abort_within);
        self.set_frame("CCD_FRAME", &window, &grace)
    }
}
