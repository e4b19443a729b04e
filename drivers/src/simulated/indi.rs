//! A simulated INDI server with a camera, a rotator and a filter wheel.
//!
//! [`Server`] is the server itself: elements in, elements out, on any clock. [`Simulated`] puts it behind a line in memory,
//! [`serve`] behind any real one (a [`Tcp`](crate::transport::tcp::Tcp) connection that a listener accepted). What the camera
//! sees comes from a [`Scene`]; [`Trouble`] makes the server fail as real ones do.
//!
//! The server's answers and their times follow the simulators of indi-bin 1.9.9: a change is answered, an unknown property is
//! not; an exposure counts as Busy until its BLOB; frames of a colour sensor say the sensor's pattern whatever their
//! origin. It is not checked against a client that is not ours.

mod devices;
mod handlers;
mod scene;
mod wire;

pub use devices::{CameraSpec, RotatorSpec, WheelSpec};
pub use scene::{OneColour, Ramp, Scene, Shot};

use crate::clock::Deadline;
use crate::indi::property::{Place, State, Vector};
use crate::indi::xml::{Limits, Parser};
use crate::transport::{Bytes, TransportError};
use handlers::Step;
use hifitime::Epoch;
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// Devices of the server, and its times.
#[derive(Debug, Clone, PartialEq)]
pub struct ServerSettings {
    /// A camera.
    pub camera: Option<CameraSpec>,
    /// A rotator.
    pub rotator: Option<RotatorSpec>,
    /// A filter wheel.
    pub wheel: Option<WheelSpec>,
    /// How long an answer takes.
    pub latency: Duration,
    /// UTC when the clock is at zero.
    pub epoch: Epoch,
}

impl Default for ServerSettings {
    /// One of each; 2026-01-01 at the clock's zero.
    fn default() -> Self {
        Self {
            camera: Some(CameraSpec::default()),
            rotator: Some(RotatorSpec::default()),
            wheel: Some(WheelSpec::default()),
            latency: Duration::from_millis(2),
            epoch: sunglint_formats::time::parse_utc("2026-01-01T00:00:00").unwrap_or_default(),
        }
    }
}

/// How frames are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Packing {
    /// FITS, or `.fits.z` where the client turned compression on.
    #[default]
    AsAsked,
    /// Called `.fits.fz`, as servers of 1.9.9 send it.
    TileCompressed,
    /// Cut off in the middle.
    Cut,
}

/// Faults of the server.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Trouble {
    /// Changes of this property end in Alert, with this message.
    pub alert: Option<(String, String)>,
    /// Exposures end without a BLOB.
    pub no_blob: bool,
    /// How frames are packed.
    pub packing: Packing,
    /// In the middle of the next exposure or motion the driver ends (`delProperty`), and is there again, not connected.
    pub lose_device: bool,
    /// In the middle of the next exposure or motion the server is gone.
    pub die: bool,
    /// Motions never end.
    pub stuck: bool,
}

/// The server.
pub struct Server {
    settings: ServerSettings,
    /// Faults of the server; may be changed while it runs.
    pub trouble: Trouble,
    scene: Box<dyn Scene>,
    vectors: BTreeMap<Place, Vector>,
    agenda: Vec<(Duration, Step)>,
    parser: Parser,
    /// The devices that the client asked for; `None` in it for all.
    watched: Vec<Option<String>>,
    blobs: bool,
    said: VecDeque<(Duration, Vec<u8>)>,
    dead: bool,
}

impl std::fmt::Debug for Server {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server").field("settings", &self.settings).finish_non_exhaustive()
    }
}

impl Server {
    /// A server that has just been started, with a camera that sees `scene`.
    pub fn new(settings: ServerSettings, scene: impl Scene + 'static) -> Self {
        let mut server = Self {
            settings,
            trouble: Trouble::default(),
            scene: Box::new(scene),
            vectors: BTreeMap::new(),
            agenda: Vec::new(),
            parser: Parser::new(Limits::default()),
            watched: Vec::new(),
            blobs: false,
            said: VecDeque::new(),
            dead: false,
        };
        server.power_on();
        server
    }

    fn power_on(&mut self) {
        self.vectors.clear();
        self.agenda.clear();
        for (device, interface) in self.devices() {
            self.vectors.extend(devices::always(&device, interface));
        }
    }

    fn devices(&self) -> Vec<(String, u32)> {
        let ServerSettings { camera, rotator, wheel, .. } = &self.settings;
        let camera = camera.as_ref().map(|spec| (spec.name.clone(), 1 << 1));
        let wheel = wheel.as_ref().map(|spec| (spec.name.clone(), 1 << 4));
        let rotator = rotator.as_ref().map(|spec| (spec.name.clone(), 1 << 12));
        [camera, wheel, rotator].into_iter().flatten().collect()
    }

    /// Starts it anew: nobody is connected, all is as after power-on but for what is wrong.
    pub fn restart(&mut self) {
        self.hang_up();
        self.dead = false;
        self.power_on();
    }

    /// The client has gone; the devices go on.
    pub fn hang_up(&mut self) {
        self.parser = Parser::new(Limits::default());
        self.watched.clear();
        self.blobs = false;
        self.said.clear();
    }

    /// Whether it has died ([`Trouble::die`]).
    pub fn is_dead(&self) -> bool {
        self.dead
    }

    /// A vector as it is: the truth for tests.
    pub fn vector(&self, device: &str, name: &str) -> Option<&Vector> {
        self.vectors.get(&Place { device: device.to_owned(), name: name.to_owned() })
    }

    /// Whether nothing is under way.
    pub fn is_at_rest(&self) -> bool {
        self.agenda.is_empty() && self.vectors.values().all(|vector| vector.state != State::Busy)
    }

    /// Takes bytes of the client at `now`.
    ///
    /// # Errors
    /// Bytes that are not INDI: a real server hangs up on them.
    pub fn hear(&mut self, bytes: &[u8], now: Duration) -> Result<(), crate::indi::xml::XmlError> {
        self.advance(now);
        if self.dead {
            return Ok(());
        }
        self.parser.feed(bytes);
        while let Some(element) = self.parser.element()? {
            self.handle(&element, now);
        }
        Ok(())
    }

    /// When something happens next by itself.
    fn next_step(&self) -> Option<Duration> {
        let said = self.said.front().map(|(due, _)| *due);
        self.agenda.iter().map(|(due, _)| *due).chain(said).min()
    }

    /// Lets time pass until `now`.
    pub fn advance(&mut self, now: Duration) {
        while let Some(first) = (0..self.agenda.len()).min_by_key(|&i| self.agenda[i].0)
            && self.agenda[first].0 <= now
            && !self.dead
        {
            let (due, step) = self.agenda.remove(first);
            self.happen(step, due);
        }
    }

    /// Says something to a client that has asked for that device.
    fn say(&mut self, device: &str, text: String, now: Duration) {
        let wanted =
            |watched: &Option<String>| watched.as_deref().is_none_or(|name| name == device);
        if self.watched.iter().any(wanted) {
            self.said.push_back((now + self.settings.latency, text.into_bytes()));
        }
    }

    /// At most `most` bytes of what has been said by `now`.
    fn take(&mut self, most: usize, now: Duration) -> Vec<u8> {
        let mut taken = Vec::new();
        while let Some((due, text)) = self.said.front_mut()
            && *due <= now
            && taken.len() < most
        {
            let count = text.len().min(most - taken.len());
            taken.extend(text.drain(..count));
            if text.is_empty() {
                self.said.pop_front();
            }
        }
        taken
    }

    fn utc(&self, now: Duration) -> Epoch {
        self.settings.epoch + hifitime::Duration::from(now)
    }
}

/// A server at the other end of a line in memory: a transport for drivers.
#[derive(Debug)]
pub struct Simulated {
    /// The server.
    pub server: Server,
}

impl Simulated {
    /// A line to the server.
    pub fn new(server: Server) -> Self {
        Self { server }
    }

    fn check(&self) -> Result<(), TransportError> {
        if self.server.is_dead() {
            return Err(TransportError::disconnected("the simulated INDI server"));
        }
        Ok(())
    }
}

impl Bytes for Simulated {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        deadline.remaining()?;
        self.check()?;
        if self.server.hear(bytes, deadline.now()).is_err() {
            // What the client said is no INDI.
            self.server.dead = true;
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            deadline.remaining()?;
            self.server.advance(deadline.now());
            let ready = self.server.take(buffer.len(), deadline.now());
            if !ready.is_empty() {
                buffer[..ready.len()].copy_from_slice(&ready);
                return Ok(ready.len());
            }
            self.check()?;
            let next = self.server.next_step();
            deadline.sleep(next.map_or(Duration::MAX, |due| due.saturating_sub(deadline.now())))?;
        }
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.server.advance(deadline.now());
        Ok(self.server.take(usize::MAX, deadline.now()))
    }
}

/// Serves on the server's end of a real line until the deadline passes, its token is set, the client hangs up, or the server
/// dies; gives the server back, for the next client.
///
/// # Errors
/// The line failed.
pub fn serve(
    mut server: Server,
    line: &mut impl Bytes,
    deadline: &Deadline,
) -> Result<Server, TransportError> {
    /// How often it looks whether something has happened by itself.
    const TICK: Duration = Duration::from_millis(5);
    let mut buffer = vec![0; 64 << 10];
    loop {
        let now = deadline.now();
        server.advance(now);
        let ready = server.take(usize::MAX, now);
        let sent = if ready.is_empty() { Ok(()) } else { line.send(&ready, deadline) };
        let heard = match sent {
            Ok(()) if server.is_dead() => return Ok(server),
            Ok(()) => line.receive(&mut buffer, &deadline.at_most(TICK)),
            Err(error) => Err(error),
        };
        match heard {
            Ok(count) if server.hear(&buffer[..count], deadline.now()).is_ok() => {}
            Err(TransportError::Timeout { .. }) if deadline.remaining().is_ok() => {}
            Ok(_)
            | Err(
                TransportError::Timeout { .. }
                | TransportError::Cancelled { .. }
                | TransportError::Disconnected { .. },
            ) => {
                server.hang_up();
                return Ok(server);
            }
            Err(error) => return Err(error),
        }
    }
}
