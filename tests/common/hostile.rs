//! INDI servers that do wrong, each in a way of its own. Synthetic: written from the protocol's text (INDI 1.7), with none of our client's code.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The device that every server claims to have.
pub const DEVICE: &str = "Cam";
/// Columns and rows of its sensor.
const SIZE: [usize; 2] = [64, 48];

/// The kinds, by name.
pub const KINDS: [&str; 32] = [
    // Before anything is defined.
    "never_accepts",
    "silent",
    "hangs_up",
    "binary",
    "endless_tag",
    "endless_comment",
    "deep_nesting",
    "endless_children",
    "entities",
    "flood_before",
    "endless_definitions",
    "pings_unread",
    // Among honest answers.
    "message_flood",
    "long_messages",
    "update_flood",
    "flapping_device",
    "duplicate_device",
    "huge_sensor",
    "nan_numbers",
    "changing_type",
    // In answer to an exposure.
    "half_open",
    "endless_blob",
    "wrong_length",
    "bad_base64",
    "wrong_size",
    "wrong_kind",
    "zip_bomb",
    "huge_fits",
    "slow_drip",
    "never_ends",
    "ok_without_frame",
    "frame_flood",
];

/// A server at work, until it is dropped.
pub struct Hostile {
    /// `HOST:PORT`.
    pub place: String,
    stop: Arc<AtomicBool>,
    /// Connections so far.
    pub connections: Arc<AtomicU64>,
    listener: Option<JoinHandle<()>>,
    /// One that nobody accepts from.
    _kept: Option<TcpListener>,
}

impl Hostile {
    /// One of [`KINDS`], or `honest`: a camera that does nothing wrong, with a gain of 0 to 100.
    pub fn start(kind: &'static str) -> Self {
        assert!(KINDS.contains(&kind) || kind == "honest", "{kind}");
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let place = listener.local_addr().unwrap().to_string();
        let stop = Arc::new(AtomicBool::new(false));
        let connections = Arc::new(AtomicU64::new(0));
        if kind == "never_accepts" {
            return Self { place, stop, connections, listener: None, _kept: Some(listener) };
        }
        listener.set_nonblocking(true).unwrap();
        let (over, count) = (stop.clone(), connections.clone());
        let thread = std::thread::spawn(move || {
            let mut serving = Vec::new();
            while !over.load(Ordering::Relaxed) {
                match listener.accept() {
                    Ok((stream, _)) => {
                        let over = over.clone();
                        let turn = count.fetch_add(1, Ordering::Relaxed);
                        stream.set_nonblocking(false).unwrap();
                        // The client's going away is the usual end.
                        serving.push(std::thread::spawn(move || {
                            let _ = Connection { kind, stream, over, turn, exposures: 0 }.serve();
                        }));
                    }
                    Err(_) => std::thread::sleep(Duration::from_millis(5)),
                }
            }
            serving.into_iter().for_each(|thread| thread.join().unwrap());
        });
        Self { place, stop, connections, listener: Some(thread), _kept: None }
    }
}

impl Drop for Hostile {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(listener) = self.listener.take() {
            let ended = listener.join();
            assert!(ended.is_ok() || std::thread::panicking(), "a hostile server's own fault");
        }
    }
}

struct Connection {
    kind: &'static str,
    stream: TcpStream,
    over: Arc<AtomicBool>,
    turn: u64,
    exposures: u64,
}

type Done = std::io::Result<()>;

impl Connection {
    fn is_over(&self) -> bool {
        self.over.load(Ordering::Relaxed)
    }

    /// Sends all of it, however slowly the client reads, until the test is over.
    fn say(&mut self, text: impl AsRef<[u8]>) -> Done {
        let mut bytes = text.as_ref();
        while !bytes.is_empty() {
            if self.is_over() {
                return Err(std::io::ErrorKind::Interrupted.into());
            }
            match self.stream.write(bytes) {
                Ok(0) => return Err(std::io::ErrorKind::WriteZero.into()),
                Ok(count) => bytes = &bytes[count..],
                Err(e) if matches!(e.kind(), std::io::ErrorKind::WouldBlock) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Sends the same piece again and again.
    fn flood(&mut self, piece: &str) -> Done {
        let piece = piece.repeat((64 << 10) / piece.len() + 1);
        loop {
            self.say(&piece)?;
        }
    }

    fn wait(&self) -> Done {
        while !self.is_over() {
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    fn serve(mut self) -> Done {
        self.stream.set_write_timeout(Some(Duration::from_millis(50)))?;
        match self.kind {
            "silent" => return self.wait(),
            "hangs_up" => return Ok(()),
            "binary" => {
                let mut state = 0x9E37_79B9_7F4A_7C15_u64;
                loop {
                    let block: Vec<u8> = (0..8192)
                        .flat_map(|_| {
                            state ^= state << 13;
                            state ^= state >> 7;
                            state ^= state << 17;
                            state.to_le_bytes()
                        })
                        .collect();
                    self.say(block)?;
                }
            }
            "endless_tag" => {
                self.say("<defNumberVector device=\"")?;
                return self.flood("x");
            }
            "endless_comment" => {
                self.say("<!-- ")?;
                return self.flood("it goes on ");
            }
            "deep_nesting" => return self.flood("<a>"),
            "endless_children" => {
                self.say("<defTextVector device='Cam' name='N' state='Ok' perm='rw'>")?;
                return self.flood("<defText name='n'>v</defText>");
            }
            "entities" => {
                self.say("<!DOCTYPE i [<!ENTITY a \"aaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]>")?;
                return self.flood("<message message='&b;&b;&b;&b;&b;&b;'/>");
            }
            "flood_before" => {
                let text = "x".repeat(1000);
                return self.flood(&format!("<message device='Cam' message='{text}'/>\n"));
            }
            "endless_definitions" => {
                self.say(definitions(self.kind))?;
                for i in 0_u64.. {
                    self.say(format!(
                        "<defTextVector device='Cam' name='T{i}' state='Ok' perm='rw'><defText name='a'>v</defText></defTextVector>\n"
                    ))?;
                }
            }
            "pings_unread" => return self.flood("<pingRequest uid='0123456789'/>\n"),
            _ => {}
        }
        self.answer()
    }

    /// Answers as a driver does, with what this kind does besides.
    fn answer(&mut self) -> Done {
        self.stream.set_read_timeout(Some(Duration::from_millis(10)))?;
        let mut heard = String::new();
        let mut buffer = [0; 4096];
        let mut defined = false;
        let mut last = Instant::now();
        while !self.is_over() {
            if defined {
                self.besides(&mut last)?;
            }
            match self.stream.read(&mut buffer) {
                Ok(0) => return Ok(()),
                Ok(count) => heard.push_str(&String::from_utf8_lossy(&buffer[..count])),
                Err(e) if matches!(e.kind(), std::io::ErrorKind::WouldBlock) => {}
                Err(error) => return Err(error),
            }
            while let Some((command, end)) = first_command(&heard) {
                heard.drain(..end);
                if command.starts_with("<getProperties") {
                    defined = true;
                    self.say(definitions(self.kind))?;
                } else if command.contains("name=\"CCD_EXPOSURE\"") {
                    let text = command.split("CCD_EXPOSURE_VALUE\">").nth(1).unwrap_or_default();
                    let text = text.split('<').next().unwrap_or_default();
                    self.expose(text.parse().unwrap_or(0.1))?;
                } else if command.starts_with("<new") {
                    let done = command.replace("<new", "<set").replace("</new", "</set");
                    self.say(done.replacen(" name=", " state=\"Ok\" name=", 1))?;
                }
            }
        }
        Ok(())
    }

    fn besides(&mut self, last: &mut Instant) -> Done {
        match self.kind {
            // As much as the client reads, while it can still be heard: half a megabyte a turn.
            "message_flood" => {
                let text = "y".repeat(200);
                let message = format!("<message device='Cam' message='{text}'/>\n");
                self.say(message.repeat(2000))
            }
            "long_messages" => {
                let text = "z".repeat(60_000);
                self.say(format!("<message device='Cam' message='{text}'/>\n"))
            }
            "update_flood" => {
                let update = "<setNumberVector device='Cam' name='CCD_TEMPERATURE' state='Ok'><oneNumber name='CCD_TEMPERATURE_VALUE'>-10</oneNumber></setNumberVector>\n";
                self.say(update.repeat(2000))
            }
            "frame_flood" => {
                let frame = fits(SIZE, 9.0);
                self.say(blob(".fits", &frame, frame.len()))
            }
            "flapping_device" if last.elapsed() > Duration::from_millis(30) => {
                *last = Instant::now();
                self.say("<delProperty device='Cam'/>\n")?;
                self.say(definitions(self.kind))
            }
            _ => Ok(()),
        }
    }

    fn state(&mut self, state: &str, left_s: f64) -> Done {
        self.say(format!(
            "<setNumberVector device='Cam' name='CCD_EXPOSURE' state='{state}'><oneNumber name='CCD_EXPOSURE_VALUE'>{left_s}</oneNumber></setNumberVector>\n"
        ))
    }

    fn expose(&mut self, exposure_s: f64) -> Done {
        self.exposures += 1;
        if self.kind == "ok_without_frame" {
            return self.state("Ok", 0.0);
        }
        self.state("Busy", exposure_s)?;
        std::thread::sleep(Duration::from_secs_f64(exposure_s.clamp(0.0, 1.0)));
        let good = fits(SIZE, exposure_s);
        match self.kind {
            "half_open" => {
                self.stream.shutdown(Shutdown::Write)?;
                self.wait()
            }
            "huge_sensor" | "endless_blob" => {
                self.say("<setBLOBVector device='Cam' name='CCD1' state='Ok'><oneBLOB name='CCD1' size='1000' format='.fits'>\n")?;
                self.flood("QUJDREVGR0hJSktMTU5PUFFSU1RVVldYWVphYmNkZWZnaGlqa2xtbm9wcXJzdHV2\n")
            }
            "wrong_length" => match self.exposures % 3 {
                0 => self.say(blob(".fits", &good, 1_000_000_000)),
                1 => self.say(blob(".fits", &good[..2880], good.len())),
                _ => self.say(blob(".fits", &[], 0)),
            },
            "bad_base64" => {
                let frame = blob(".fits", &good, good.len());
                self.say(frame.replacen("AAAA", "A=!A", 1).replacen("IC", "\u{fc}", 1))
            }
            "wrong_size" => {
                let frame = fits([32, 32], exposure_s);
                self.say(blob(".fits", &frame, frame.len()))
            }
            "wrong_kind" => {
                let format = [".jpg", ".xisf", "", ".fits.fz", "\u{1b}[2J"][self.exposures as usize % 5];
                self.say(blob(format, &good, good.len()))
            }
            "zip_bomb" => {
                // 64 MiB of zeros: a stored header and runs of 258, by hand (RFC 1950, 1951: one fixed-code block).
                let bomb = zeros_deflated(64 << 20);
                self.say(blob_sized(".fits.z", &bomb, bomb.len(), 64 << 20))
            }
            "huge_fits" => {
                let frame = match self.exposures % 3 {
                    0 => header(&[("NAXIS1", "1000000"), ("NAXIS2", "1000000")], exposure_s),
                    1 => header(&[("NAXIS1", "-5"), ("NAXIS2", "9223372036854775807")], exposure_s),
                    // Cards without an end.
                    _ => [b' '; 80].repeat(5000),
                };
                self.say(blob(".fits", &frame, frame.len()))
            }
            "slow_drip" => {
                for byte in blob(".fits", &good, good.len()).bytes() {
                    self.say([byte])?;
                    std::thread::sleep(Duration::from_millis(20));
                }
                Ok(())
            }
            "never_ends" => loop {
                self.state("Busy", exposure_s / 2.0)?;
                std::thread::sleep(Duration::from_millis(100));
            },
            "changing_type" => self.say(
                "<defTextVector device='Cam' name='CCD_EXPOSURE' state='Ok' perm='rw'><defText name='CCD_EXPOSURE_VALUE'>soon</defText></defTextVector>\n",
            ),
            "duplicate_device" => {
                // Two drivers of one name: each says that it exposes, and each gives a frame.
                let other = fits(SIZE, 7.0);
                self.state("Busy", 7.0)?;
                self.say(blob(".fits", &other, other.len()))?;
                self.say(definitions("huge_sensor"))?;
                self.say(definitions(self.kind))?;
                self.say(blob(".fits", &good, good.len()))?;
                self.state("Ok", 0.0)
            }
            "frame_flood" if self.turn % 2 == 1 => self.state("Alert", 0.0),
            _ => {
                self.state("Ok", 0.0)?;
                self.say(blob(".fits", &good, good.len()))
            }
        }
    }
}

/// The first whole command of what the client said, and its end.
fn first_command(heard: &str) -> Option<(String, usize)> {
    let begin = heard.find('<')?;
    let rest = &heard[begin..];
    let name: String = rest[1..].chars().take_while(char::is_ascii_alphanumeric).collect();
    let first = rest.find('>')?;
    let end = match rest[..first].ends_with('/') {
        true => first + 1,
        false => {
            let close = format!("</{name}>");
            rest.find(&close)? + close.len()
        }
    };
    Some((rest[..end].to_owned(), begin + end))
}

/// Definitions that a camera sends.
fn definitions(kind: &str) -> String {
    let sensor = match kind {
        "huge_sensor" => [1_000_000; 2],
        _ => SIZE,
    };
    let (binning, least, temperature) = match kind {
        "nan_numbers" => ("nan", "nan", "inf"),
        _ => ("1", "0.001", "-10"),
    };
    let number = |name: &str, perm: &str, members: &[(&str, &str, &str, &str)]| {
        let members: String = members
            .iter()
            .map(|(name, value, min, max)| {
                format!("<defNumber name='{name}' label='{name}' format='%g' min='{min}' max='{max}' step='0'>\n{value}\n</defNumber>")
            })
            .collect();
        format!(
            "<defNumberVector device='Cam' name='{name}' label='{name}' group='g' state='Idle' perm='{perm}' timeout='60' timestamp='2026-01-01T00:00:00'>{members}</defNumberVector>\n"
        )
    };
    let [columns, rows] = sensor.map(|n| n.to_string());
    let (columns, rows) = (columns.as_str(), rows.as_str());
    let mut text = String::from(
        "<defSwitchVector device='Cam' name='CONNECTION' state='Ok' perm='rw' rule='OneOfMany'><defSwitch name='CONNECT'>On</defSwitch><defSwitch name='DISCONNECT'>Off</defSwitch></defSwitchVector>\n\
         <defTextVector device='Cam' name='DRIVER_INFO' state='Idle' perm='ro'><defText name='DRIVER_NAME'>Cam</defText><defText name='DRIVER_EXEC'>x</defText><defText name='DRIVER_VERSION'>1</defText><defText name='DRIVER_INTERFACE'>2</defText></defTextVector>\n\
         <defBLOBVector device='Cam' name='CCD1' state='Idle' perm='ro'><defBLOB name='CCD1'/></defBLOBVector>\n",
    );
    text += &number("CCD_EXPOSURE", "rw", &[("CCD_EXPOSURE_VALUE", "0", least, "3600")]);
    text += &number(
        "CCD_FRAME",
        "rw",
        &[
            ("X", "0", "0", columns),
            ("Y", "0", "0", rows),
            ("WIDTH", columns, "1", columns),
            ("HEIGHT", rows, "1", rows),
        ],
    );
    text +=
        &number("CCD_BINNING", "rw", &[("HOR_BIN", binning, "1", "4"), ("VER_BIN", "1", "1", "4")]);
    text += &number(
        "CCD_INFO",
        "ro",
        &[("CCD_MAX_X", columns, "0", "0"), ("CCD_MAX_Y", rows, "0", "0")],
    );
    text += &number("CCD_GAIN", "rw", &[("GAIN", "10", "0", "100")]);
    text +=
        &number("CCD_TEMPERATURE", "rw", &[("CCD_TEMPERATURE_VALUE", temperature, "-50", "50")]);
    text
}

fn card(text: &str) -> String {
    format!("{text:<80}")
}

fn header(sizes: &[(&str, &str)], exposure_s: f64) -> Vec<u8> {
    let mut text = card("SIMPLE  =                    T");
    text += &card("BITPIX  =                   16");
    text += &card("NAXIS   =                    2");
    for (name, size) in sizes {
        text += &card(&format!("{name:<8}= {size:>20}"));
    }
    text += &card("BZERO   =                32768");
    text += &card("BSCALE  =                    1");
    text += &card(&format!("EXPTIME = {exposure_s:>20}"));
    text += &card("DATE-OBS= '2026-01-01T00:00:00.000'");
    text += &card("END");
    let mut bytes = text.into_bytes();
    bytes.resize(bytes.len().next_multiple_of(2880), b' ');
    bytes
}

/// A frame of 1000 ADU (FITS 4.0, sections 4 and 5: unsigned 16 bits by BZERO).
fn fits([columns, rows]: [usize; 2], exposure_s: f64) -> Vec<u8> {
    let sizes = [("NAXIS1", columns.to_string()), ("NAXIS2", rows.to_string())];
    let mut bytes =
        header(&sizes.each_ref().map(|(name, size)| (*name, size.as_str())), exposure_s);
    for _ in 0..columns * rows {
        bytes.extend_from_slice(&(1000_i32 - 32768).to_be_bytes()[2..]);
    }
    bytes.resize(bytes.len().next_multiple_of(2880), 0);
    bytes
}

/// Base64 of RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let value = group.iter().fold(0_u32, |sum, &byte| sum << 8 | u32::from(byte))
            << (8 * (3 - group.len()));
        for place in 0..4 {
            let plain = place <= group.len();
            let index = (value >> (18 - 6 * place) & 63) as usize;
            text.push(if plain { char::from(ALPHABET[index]) } else { '=' });
        }
    }
    text
}

fn blob_sized(format: &str, bytes: &[u8], len: usize, size: usize) -> String {
    let text = base64(bytes);
    format!(
        "<setBLOBVector device='Cam' name='CCD1' state='Ok' timestamp='2026-01-01T00:00:00'><oneBLOB name='CCD1' size='{size}' len='{len}' format='{format}'>\n{text}\n</oneBLOB></setBLOBVector>\n"
    )
}

fn blob(format: &str, bytes: &[u8], len: usize) -> String {
    blob_sized(format, bytes, len, len)
}

/// A zlib stream of so many zeros, bit by bit: a literal zero, then matches of 258 at distance 1 in one block of fixed codes.
fn zeros_deflated(count: usize) -> Vec<u8> {
    let mut bytes = vec![0x78, 0x01];
    let (mut held, mut filled) = (0_u32, 0);
    let mut put = |value: u32, bits: u32, bytes: &mut Vec<u8>| {
        held |= value << filled;
        filled += bits;
        while filled >= 8 {
            bytes.push(held as u8);
            held >>= 8;
            filled -= 8;
        }
    };
    // Last block, fixed codes.
    put(1, 1, &mut bytes);
    put(1, 2, &mut bytes);
    // Codes go from their highest bit on: the literal 0 is 00110000, length 258 is 11000101, distance 1 is 00000.
    put(0b0000_1100, 8, &mut bytes);
    for _ in 0..count / 258 {
        put(0b1010_0011, 8, &mut bytes);
        put(0, 5, &mut bytes);
    }
    put(0, 7, &mut bytes);
    put(0, 7, &mut bytes);
    // The sum (Adler-32) is wrong for these zeros, which nobody should come to see.
    bytes.extend_from_slice(&[0; 4]);
    bytes
}
