//! This module reads the energy that the machine's processors take, where it tells.

use std::fs;
use std::path::{Path, PathBuf};

/// The folder in which Linux tells of the counters (RAPL; Intel's and AMD's processors). Root alone may read them by default.
pub const COUNTERS: &str = "/sys/class/powercap";

/// A meter of the energy that all processor packages take from its start on; of the whole machine, without graphics cards.
pub struct EnergyMeter {
    packages: Vec<Package>,
}

struct Package {
    folder: PathBuf,
    /// Microjoules at the start.
    start: u64,
    /// Microjoules that the counter goes up to before it begins at 0 again.
    range: u64,
}

impl EnergyMeter {
    /// Starts with the counters in `folder`, [`COUNTERS`]; `None` where there is none that can be read.
    pub fn start(folder: &Path) -> Option<EnergyMeter> {
        let entries = fs::read_dir(folder).ok()?.flatten();
        let packages: Vec<Package> = entries.filter_map(|e| Package::of(e.path())).collect();
        (!packages.is_empty()).then_some(EnergyMeter { packages })
    }

    /// Returns the joules since the start; `None` if a counter can no longer be read. A counter that came round more than once
    /// is short of that: they take an hour or so.
    pub fn joules(&self) -> Option<f64> {
        let each = self.packages.iter().map(|package| {
            let now = number(&package.folder.join("energy_uj"))?;
            let taken = match now.checked_sub(package.start) {
                Some(taken) => taken,
                None => package.range.checked_sub(package.start)?.checked_add(now)?,
            };
            Some(1e-6 * taken as f64)
        });
        each.sum()
    }
}

impl Package {
    /// Returns the package of a counter's folder; `None` where it is another, a part of one (a core, memory) or no counter.
    fn of(folder: PathBuf) -> Option<Package> {
        let name = fs::read_to_string(folder.join("name")).ok()?;
        name.starts_with("package").then_some(())?;
        Some(Package {
            start: number(&folder.join("energy_uj"))?,
            range: number(&folder.join("max_energy_range_uj"))?,
            folder,
        })
    }
}

fn number(file: &Path) -> Option<u64> {
    fs::read_to_string(file).ok()?.trim().parse().ok()
}
