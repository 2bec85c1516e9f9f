//! This module reads budgets and tolerances as they are written: `20MB`, `3min`, `0.1dB`.

use std::str::FromStr;

/// What a trained scene may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Budget {
    /// The file, of 10^6 bytes.
    Megabytes(f64),
    /// Training.
    Seconds(f64),
}

/// What pruning may cost, dB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Decibels(pub(crate) f64);

/// The budget of a number of some unit.
type OfUnit = fn(f64) -> Budget;

/// Units, the longer of two that end alike first.
const UNITS: [(&str, OfUnit); 6] = [
    ("kB", |n| Budget::Megabytes(1e-3 * n)),
    ("MB", Budget::Megabytes),
    ("GB", |n| Budget::Megabytes(1e3 * n)),
    ("min", |n| Budget::Seconds(60.0 * n)),
    ("h", |n| Budget::Seconds(3600.0 * n)),
    ("s", Budget::Seconds),
];

impl FromStr for Budget {
    type Err = String;

    fn from_str(text: &str) -> Result<Budget, String> {
        let found = UNITS.iter().find_map(|(unit, budget)| {
            let number = text.strip_suffix(unit)?.trim().parse::<f64>().ok()?;
            (number > 0.0 && number.is_finite()).then(|| budget(number))
        });
        let expected = "a budget is a number above 0 of kB, MB, GB, s, min or h: 20MB, 3min";
        found.ok_or_else(|| expected.to_owned())
    }
}

impl FromStr for Decibels {
    type Err = String;

    fn from_str(text: &str) -> Result<Decibels, String> {
        let number = text.strip_suffix("dB").unwrap_or(text).trim();
        match number.parse::<f64>() {
            Ok(db) if db >= 0.0 && db.is_finite() => Ok(Decibels(db)),
            _ => Err("a tolerance is a number of dB, 0 or more: 0.1dB".to_owned()),
        }
    }
}
