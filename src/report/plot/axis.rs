//! An axis is linear, logarithmic or of categories.

use std::ops::Range;

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};

/// Share of the extent left free at either end.
const MARGIN: f64 = 0.05;

/// About as many ticks on an axis.
const N_TICKS: f64 = 8.0;

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Linear,
    Log,
    Categories(Vec<String>),
}

/// An axis with its label, which names the unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// The text along the axis: the quantity, with its unit.
    pub label: String,
    kind: Kind,
}

impl Axis {
    /// Returns an axis on which equal differences have equal lengths.
    pub fn linear(label: &str) -> Axis {
        Axis {
            label: label.to_owned(),
            kind: Kind::Linear,
        }
    }

    /// Returns a logarithmic axis, base 10; it shows positive values only.
    pub fn log(label: &str) -> Axis {
        Axis {
            label: label.to_owned(),
            kind: Kind::Log,
        }
    }

    /// Names at 0, 1, 2, ...
    pub fn categories(label: &str, names: Vec<String>) -> Axis {
        Axis {
            label: label.to_owned(),
            kind: Kind::Categories(names),
        }
    }

    /// Returns the place of a value along the axis; not finite for one that it cannot show.
    pub(super) fn place(&self, value: f64) -> f64 {
        match self.kind {
            Kind::Log => value.log10(),
            _ => value,
        }
    }

    /// Returns the stretch to show, in places, with some room at the ends; `None` without a value.
    pub(super) fn extent(&self, values: impl Iterator<Item = f64>) -> Option<Range<f64>> {
        if let Kind::Categories(names) = &self.kind {
            return (!names.is_empty()).then(|| -0.5..names.len() as f64 - 0.5);
        }
        let places = values.map(|v| self.place(v)).filter(|p| p.is_finite());
        let range = places.fold(f64::INFINITY..f64::NEG_INFINITY, |range, p| {
            range.start.min(p)..range.end.max(p)
        });
        if range.start > range.end {
            return None;
        }
        let span = range.end - range.start;
        let margin = if span > 1e-9 * range.end.abs() {
            MARGIN * span
        } else {
            // One value: any stretch around it that shows its size.
            (0.1 * range.end.abs()).max(1e-3)
        };
        Some(range.start - margin..range.end + margin)
    }

    /// Returns the coordinates that `plotters` draws over an extent.
    pub(super) fn places(&self, extent: &Range<f64>) -> Places {
        Places {
            extent: extent.clone(),
            ticks: self.ticks(extent),
        }
    }

    /// Places of the ticks within an extent.
    fn ticks(&self, extent: &Range<f64>) -> Vec<f64> {
        match &self.kind {
            Kind::Categories(names) => (0..names.len()).map(|i| i as f64).collect(),
            Kind::Linear => round_steps(extent),
            Kind::Log => {
                let decades = extent.start.floor() as i32..=extent.end.ceil() as i32;
                // Beyond a few decades only their starts have room.
                let digits: &[f64] = if extent.end - extent.start < 3.0 {
                    &[1.0, 2.0, 5.0]
                } else {
                    &[1.0]
                };
                let ticks =
                    decades.flat_map(|k| digits.iter().map(move |d| f64::from(k) + d.log10()));
                let ticks: Vec<f64> = ticks.filter(|t| extent.contains(t)).collect();
                if ticks.len() < 2 {
                    round_steps(extent)
                } else {
                    ticks
                }
            }
        }
    }

    /// Returns the label of a tick.
    pub(super) fn format(&self, place: f64) -> String {
        match &self.kind {
            Kind::Linear => plain(place),
            Kind::Log => plain(10f64.powf(place)),
            Kind::Categories(names) => names
                .get(place.round().max(0.0) as usize)
                .cloned()
                .unwrap_or_default(),
        }
    }
}

/// An extent with the ticks chosen for it.
pub(super) struct Places {
    extent: Range<f64>,
    ticks: Vec<f64>,
}

impl Ranged for Places {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, place: &f64, pixels: (i32, i32)) -> i32 {
        let share = (place - self.extent.start) / (self.extent.end - self.extent.start);
        pixels.0 + (f64::from(pixels.1 - pixels.0) * share).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.extent.clone()
    }
}

/// Returns the multiples of 1, 2 or 5 times a power of ten within `extent`.
fn round_steps(extent: &Range<f64>) -> Vec<f64> {
    let least = (extent.end - extent.start) / N_TICKS;
    let power = 10f64.powf(least.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|digit| digit * power)
        .into_iter()
        .find(|step| *step >= least)
        .unwrap_or(least);
    let first = (extent.start / step).ceil() as i64;
    let last = (extent.end / step).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// Returns a number as people write it: four digits, no trailing zeros, powers of ten only where it
/// would be long otherwise.
pub(super) fn plain(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let power = value.abs().log10().floor();
    if !(-4.0..6.0).contains(&power) {
        let text = format!("{value:.3e}");
        let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        return format!("{}e{exponent}", trimmed(digits));
    }
    let decimals = (3.0 - power).clamp(0.0, 7.0) as usize;
    trimmed(&format!("{value:.decimals$}")).to_owned()
}

fn trimmed(digits: &str) -> &str {
    if digits.contains('.') {
        digits.trim_end_matches('0').trim_end_matches('.')
    } else {
        digits
    }
}
