//! The program without OpenCV, whose two hundred libraries take a third of a second to load: what the tests run where no grabber is asked for.

use std::process::ExitCode;

fn main() -> ExitCode {
    sunglint::program()
}
