//! The candidate grid against the continuous sampling distribution.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use gspotential::camera::Camera;
use gspotential::config::Config;
use gspotential::error::Result;
use gspotential::field::{Field, Focus, fibonacci_sphere};
use gspotential::scene::Scene;
use gspotential::views::{draw_without_replacement, potential_weights};

use super::Measured;
use super::clock::of_cpu;

/// Candidates that stand for the whole sphere.
const FINEST: usize = 1 << 20;

/// Candidates that are timed in a row: the system's clock of CPU time is coarse.
const REPEATED: usize = 1 << 19;

/// Cells of equal area: bands of height, and sectors.
const BANDS: usize = 8;
const SECTORS: usize = 16;

/// Times the weights and the draw on grids of several sizes, and takes the total variation between
/// where the draws fall and the density that a grid without end would give.
pub(crate) fn measure(scene: &Scene, config: &Config, rounds: usize) -> Result<Vec<Measured>> {
    let cameras: Vec<Camera> = scene.train.iter().map(|view| view.camera.clone()).collect();
    let focus = Focus::find(&cameras, &scene.cloud)?;
    let field = Field::new(&cameras, &focus, &config.field);
    let epsilon = config.views.epsilon;
    let kept = config.field.n_candidates;
    let finest = fibonacci_sphere(FINEST);
    let exact = in_cells(&finest, &potential_weights(&field, &finest, epsilon));

    // Mean absolute deviation of each cell's share among independent draws, summed and halved.
    let spread: f64 = exact.iter().map(|p| (p * (1.0 - p)).sqrt()).sum();
    let scatter = 0.5 * spread * (2.0 / (PI * config.views.count as f64)).sqrt();

    let sizes = [256, 512, 1024, 2048, 4096, 8192, 16_384, 65_536];
    let mut best = [f64::INFINITY; 8];
    for _ in 0..rounds {
        for (best, n) in best.iter_mut().zip(sizes) {
            let repeats = REPEATED / n;
            let seconds = of_cpu(|| {
                for _ in 0..repeats {
                    let candidates = fibonacci_sphere(n);
                    let weights = potential_weights(&field, &candidates, epsilon);
                    draw_without_replacement(&weights, config.views.count, config.seed)?;
                }
                Ok(())
            })?;
            *best = best.min(seconds / repeats as f64);
        }
    }
    let measured = sizes.into_iter().zip(best).map(|(n, seconds)| {
        let candidates = fibonacci_sphere(n);
        let weights = potential_weights(&field, &candidates, epsilon);
        let drawn = inclusion(&weights, config.views.count);
        let ours = in_cells(&candidates, &drawn);
        let distance: f64 = ours.iter().zip(&exact).map(|(a, b)| (a - b).abs()).sum();
        Measured {
            choice: "candidate grid",
            setting: n.to_string(),
            kept: n == kept,
            seconds,
            error: 0.5 * distance,
            note: format!("one draw scatters {scatter:.2}"),
        }
    });
    Ok(measured.collect())
}

/// Probability of each candidate to be among `count` drawn without replacement. A candidate is
/// drawn where its exponential key of rate `w` is among the smallest: below a threshold that, with
/// many candidates, is that of `count` keys on average.
fn inclusion(weights: &[f64], count: usize) -> Vec<f64> {
    let at = |threshold: f64| weights.iter().map(move |w| 1.0 - (-w * threshold).exp());
    let count = (count as f64).min(weights.len() as f64 - 0.5);
    let (mut low, mut high) = (0.0, 1.0);
    while at(high).sum::<f64>() < count {
        high *= 2.0;
    }
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if at(middle).sum::<f64>() < count {
            low = middle;
        } else {
            high = middle;
        }
    }
    at(high).collect()
}

/// Share of the weight in each cell.
fn in_cells(directions: &[DVec3], weights: &[f64]) -> Vec<f64> {
    let mut cells = vec![0.0; BANDS * SECTORS];
    let index = |share: f64, n: usize| ((share * n as f64) as usize).min(n - 1);
    for (p, weight) in directions.iter().zip(weights) {
        let band = index(0.5 * (p.z + 1.0), BANDS);
        let sector = index(p.y.atan2(p.x) / TAU + 0.5, SECTORS);
        cells[band * SECTORS + sector] += weight;
    }
    let total: f64 = cells.iter().sum();
    cells.iter().map(|cell| cell / total).collect()
}
