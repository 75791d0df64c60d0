//! The command `vitruvian`.

use std::process::ExitCode;

fn main() -> ExitCode {
    vitruvian::run()
}
