//! This module finds where photographs leave the scene uncovered, and where another would help
//! most.
//!
//! A direction about the focus is uncovered by `max(0, 1 - U_info)`: 0 where a photograph was
//! taken from, 1 where none informs it. Only elevations near the cameras' own count: nobody
//! photographs a table from below.

use glam::DVec3;

use crate::camera::compass::Compass;
use crate::field::{Field, fibonacci_sphere};

/// The band reaches this far beyond the cameras' own elevations, degrees.
const BAND_MARGIN: f64 = 15.0;

/// Directions on the whole sphere; those within the band are looked at.
const N_DIRECTIONS: usize = 4096;

/// How much of the sphere the photographs leave uncovered.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaps {
    /// Elevations that count, degrees, from low to high.
    pub band: [f64; 2],
    /// Mean over the band, in [0, 1].
    pub mean: f64,
    /// The least covered direction of the band; the first of equals.
    pub worst: DVec3,
    /// How uncovered it is, in [0, 1].
    pub worst_value: f64,
    /// The place of one more photograph that leaves the least mean, among directions that are
    /// themselves uncovered at least half as much as the worst. Kernels are wide: the mean alone
    /// may gain most beside a photograph that is there already, between two holes, and shows
    /// nothing new.
    pub advice: DVec3,
    /// The mean with it.
    pub mean_with_advice: f64,
}

/// Returns how uncovered a unit direction is, in [0, 1].
pub fn uncovered(field: &Field, direction: DVec3) -> f64 {
    (1.0 - field.u_info(direction)).max(0.0)
}

impl Gaps {
    /// Looks for the gaps that the field's cameras leave; `None` without a camera.
    pub fn find(field: &Field, compass: &Compass) -> Option<Gaps> {
        let elevations = field.directions.iter().map(|d| compass.angles(*d).1);
        let (low, high) = elevations.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), e| {
            (low.min(e), high.max(e))
        });
        let band = [
            (low - BAND_MARGIN).max(-90.0),
            (high + BAND_MARGIN).min(90.0),
        ];
        let is_within = |d: &DVec3| (band[0]..=band[1]).contains(&compass.angles(*d).1);
        let directions: Vec<DVec3> = fibonacci_sphere(N_DIRECTIONS)
            .into_iter()
            .filter(is_within)
            .collect();
        let informed: Vec<f64> = directions.iter().map(|d| field.u_info(*d)).collect();
        let mean = |extra: &dyn Fn(DVec3) -> f64| {
            let each = directions.iter().zip(&informed);
            let sum: f64 = each.map(|(d, u)| (1.0 - u - extra(*d)).max(0.0)).sum();
            sum / directions.len() as f64
        };
        let mean_with = |direction: &DVec3| {
            let alone = Field {
                directions: vec![*direction],
                ..field.clone()
            };
            mean(&|d| alone.u_info(d))
        };
        let means: Vec<f64> = directions.iter().map(mean_with).collect();
        let all = 0..directions.len();
        let worst = first_least(all.clone(), &informed)?;
        // If nothing is uncovered, that is the worst alone.
        let bound = 0.5 * (informed[worst] + informed[worst].max(1.0));
        let advice = first_least(all.filter(|i| informed[*i] <= bound), &means)?;
        Some(Gaps {
            band,
            mean: mean(&|_| 0.0),
            worst: directions[worst],
            worst_value: (1.0 - informed[worst]).max(0.0),
            advice: directions[advice],
            mean_with_advice: means[advice],
        })
    }
}

/// Returns the first of `indices` with the least value.
fn first_least(indices: impl Iterator<Item = usize>, values: &[f64]) -> Option<usize> {
    indices.min_by(|a, b| values[*a].total_cmp(&values[*b]))
}
