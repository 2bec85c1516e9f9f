//! The `gspotential` command: parse, dispatch, exit code.

use std::process::ExitCode;

use clap::Parser;
use gspotential::cli::Cli;
use gspotential::terminal::logging;

fn main() -> ExitCode {
    quiet_device_selection();
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            logging::end(&error);
            ExitCode::from(error.exit_code())
        }
    }
}

/// Mesa's Vulkan layer for choosing a device asks the Wayland server, and where no desktop
/// runs it writes `error: XDG_RUNTIME_DIR is invalid` to stderr, twice, which
/// reads as if this program had failed. The layer's own variable switches it off.
fn quiet_device_selection() {
    let is_set = |name: &str| std::env::var_os(name).is_some();
    if !is_set("XDG_RUNTIME_DIR") && !is_set("MESA_VK_DEVICE_SELECT") {
        // SAFETY: no other thread has been started that could read the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}
