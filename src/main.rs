//! The program.

use std::process::ExitCode;

fn main() -> ExitCode {
    #[cfg(feature = "opencv")]
    sunglint_drivers_opencv::provide();
    sunglint::program()
}
