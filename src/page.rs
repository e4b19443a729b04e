//! `sunglint page`: a recorded session in the browser; and the address of a page, for `sunglint observe --page` too.

use crate::interrupt::{Hangup, listen};
use crate::output::{Console, Usage};
use clap::Args;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::net::{IpAddr, SocketAddr};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::mpsc::channel;
use sunglint_calibration::timing::read_timings;
use sunglint_formats::ecsv;
use sunglint_page::{Calibration, Recording, Server, Source};
use sunglint_radiometry::light_curve::LightCurve;

/// Arguments of `sunglint page`.
#[derive(Debug, Args)]
pub struct PageArgs {
    /// The session's folder, as `sunglint observe` made it
    pub session: PathBuf,
    /// Where the page is served: an address of this computer and a port [default: 127.0.0.1 and the first free port from 8650 on]
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "", hide_default_value = true)]
    pub address: String,
    /// Light curves that are drawn beneath the counts, such as what `sunglint simulate` predicts (ECSV)
    #[arg(long, value_name = "CURVE")]
    pub predicted: Vec<PathBuf>,
    /// Magnitudes by the coefficients κ of this file, which `sunglint calibrate` wrote (ECSV)
    #[arg(long, value_name = "KAPPA")]
    pub calibration: Option<PathBuf>,
    /// When the cameras expose, as `sunglint timing` measured it: is taken off the times of the frames of a visit that is reduced again
    #[arg(long, value_name = "FILE")]
    pub timing: Option<PathBuf>,
    /// Print the address and open no browser
    #[arg(long)]
    pub no_open: bool,
}

/// Reads the curves that are drawn beneath the counts.
///
/// # Errors
/// A file that is no light curve.
pub fn predicted(paths: &[PathBuf]) -> anyhow::Result<Vec<LightCurve>> {
    let read = |path: &PathBuf| Ok(LightCurve::from_table(path, &ecsv::read(path)?)?);
    paths.iter().map(read).collect()
}

/// Reads the calibration by which magnitudes are shown.
///
/// # Errors
/// A file that is no calibration.
pub fn calibration(path: Option<&PathBuf>) -> anyhow::Result<Option<Calibration>> {
    Ok(path.map(|path| Calibration::read(path)).transpose()?)
}

/// Serves a recorded session until Ctrl-C.
///
/// # Errors
/// A folder that is no session; an address that cannot be listened at.
pub fn run(args: &PageArgs, console: Console) -> anyhow::Result<()> {
    let address = address_of(&args.address)?;
    let calibration = calibration(args.calibration.as_ref())?;
    let recording = Recording::open(&args.session)?
        .beside(&predicted(&args.predicted)?)
        .calibrated(calibration.as_ref())
        .timed(args.timing.as_deref().map(read_timings).transpose()?);
    let may = "sees the session and saves reductions";
    serve(address, Arc::new(recording), may, !args.no_open, console)
}

/// Serves a page until Ctrl-C. `may` says what whoever has the address with the token does; `opens`: in a browser, too.
///
/// # Errors
/// An address that cannot be listened at.
pub fn serve(
    address: Option<SocketAddr>,
    source: Arc<dyn Source>,
    may: &str,
    opens: bool,
    console: Console,
) -> anyhow::Result<()> {
    let server = Server::start(address, source)?;
    let url = announce(&server, may, console);
    let (end, ended) = channel();
    listen(Hangup::Ends, move || {
        let _ = end.send(());
    })?;
    // It lies there until the page ends.
    let _door = if opens { open(&url, console) } else { None };
    console.say("Ctrl-C ends it");
    // Until somebody asks it to end.
    let _ = ended.recv();
    Ok(())
}

/// The address and port of a page: `ADDRESS:PORT`, an address or a port alone; `None` for an empty text.
///
/// # Errors
/// Any other text.
pub fn address_of(text: &str) -> Result<Option<SocketAddr>, Usage> {
    if text.is_empty() {
        return Ok(None);
    }
    let here = IpAddr::from([127, 0, 0, 1]);
    let numbers = if text == "localhost" { "127.0.0.1" } else { text };
    let numbers = numbers.replace("localhost:", "127.0.0.1:");
    let both = numbers.parse::<SocketAddr>().ok();
    let port = numbers.parse::<u16>().ok().map(|port| SocketAddr::new(here, port));
    let host = numbers.parse::<IpAddr>().ok().map(|ip| SocketAddr::new(ip, 8650));
    both.or(port).or(host).map(Some).ok_or_else(|| {
        Usage(format!(
            "the page's address is `{text}`, expected an address and a port such as 127.0.0.1:8650"
        ))
    })
}

/// Prints where a page is, and gives the address to open, with the token. `may` says what whoever has it does.
pub fn announce(server: &Server, may: &str, console: Console) -> String {
    if server.is_open() {
        console.warn(&format!(
            "the page is open to other computers at {}, without encryption: whoever has the address with its token {may}; use it in a network that you trust",
            server.address()
        ));
    }
    console.say(&format!("page: {}", server.url_with_token()));
    if !server.is_open() {
        console.say(&format!("page that only shows: {}", server.url()));
    }
    server.url_with_token()
}

/// File that leads a browser to the page, for this user's eyes alone, removed in the end. Every user of the computer can read a command line, so that the token must not
/// stand in one.
#[derive(Debug)]
struct Door(PathBuf);

impl Door {
    fn make(url: &str) -> std::io::Result<Self> {
        let own = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
        let folder = own.filter(|folder| folder.is_dir()).unwrap_or_else(std::env::temp_dir);
        let name = format!("sunglint-page-{}.html", std::process::id());
        let path = folder.join(name);
        // Left by a program of this number that was killed.
        let _ = std::fs::remove_file(&path);
        let mut options = OpenOptions::new();
        // A file or a link that somebody else put there is refused.
        let mut file = options.write(true).create_new(true).mode(0o600).open(&path)?;
        let door = Self(path);
        write!(
            file,
            "<!doctype html><meta charset=\"utf-8\"><title>sunglint</title>\n<meta http-equiv=\"refresh\" content=\"0; url={url}\">\n<a href=\"{url}\">the page</a>\n"
        )?;
        Ok(door)
    }
}

impl Drop for Door {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Shows a page in the browser; without one the address is printed all the same.
fn open(url: &str, console: Console) -> Option<Door> {
    let door = match Door::make(url) {
        Ok(door) => door,
        Err(error) => {
            console.say(&format!(
                "cannot write a file for the browser ({error}): open the address in a browser"
            ));
            return None;
        }
    };
    let browser = Command::new("xdg-open")
        .arg(&door.0)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    if let Err(error) = browser {
        console.say(&format!("cannot start xdg-open ({error}): open the address in a browser"));
    }
    Some(door)
}
