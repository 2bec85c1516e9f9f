//! Bundle adjustment without a network refines cameras and one scale a depth map until the views
//! agree on where surfaces are and what colour they have.
//!
//! A sample pixel of one view becomes a point, which is looked for in another view. Two residuals
//! compare: the logarithm of its depth with that of the other's depth map, and its brightness with
//! the other's. Both are robust (Geman and McClure 1987), so that what is hidden or reflects does
//! not pull. Gauss-Newton steps with Levenberg's damping go from coarse to fine images. The first
//! view's pose holds the frame; what the views are expected to be off holds the unit.

use glam::DVec2;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::DepthMap;
use super::edges::{interpolated, is_edge};
use super::luma::Luma;
use crate::camera::Camera;

/// Numbers that are refined of a view: six of a motion, and the logarithm of its depths' scale.
const PARAMETERS: usize = 7;
/// The motion's.
const POSE: usize = 6;
/// Blurs of the images, in turn: sides of the squares that are averaged, pixels.
const BLURS: [usize; 4] = [8, 4, 2, 1];
/// Most steps at each of them, and the share of the cost that ends them when a step gains less.
const STEPS: usize = 30;
const LEAST_GAIN: f64 = 1e-4;
/// Sample pixels of a view, about.
const SAMPLES: usize = 1500;
/// Residuals of this size count a quarter of what they would without robustness: logarithms of
/// depth, at the finest images; and brightness, where white is 1.
const DEPTH_SIZE: f64 = 0.01;
const BRIGHTNESS_SIZE: f64 = 0.05;
/// How far off a view may be before a hundred samples have to say so: radians, shares of the
/// median depth, and of its depths' scale.
const EXPECTED: [f64; 3] = [0.035, 0.03, 0.05];
const PRIOR_SAMPLES: f64 = 100.0;
/// Share of the residual that has to go before the views are moved. Images that are not quite alike
/// and depths between pixels let cameras gain less that are right: exact ones gained 0 to 1.5 % in
/// three scenes and were moved by up to 0.4 degrees, those off by a degree gained 8 to 26 %
/// (`benches/photographs.rs`).
const LEAST_FALL: f64 = 0.05;
/// Steps for derivatives: radians, shares of the median depth, and logarithms.
const DIFFERENCE: f64 = 1e-4;

/// The outcome of an adjustment.
#[derive(Clone, Debug)]
pub struct Adjusted {
    /// The views as refined, or as they were.
    pub maps: Vec<DepthMap>,
    /// Mean robust residual between 0 and 1 before and after, at pixels that were not used; the
    /// latter also where it was not kept.
    pub residual: [f64; 2],
    /// Whether the residual fell by enough, so that the refined views are kept.
    pub kept: bool,
}

/// The parameters of a view that are refined.
#[derive(Clone)]
struct State {
    camera: Camera,
    scale_log: f64,
}

/// A view and where it is held to be.
#[derive(Clone, Copy)]
struct Moved<'a> {
    view: usize,
    state: &'a State,
}

impl<'a> Moved<'a> {
    fn new(view: usize, state: &'a State) -> Moved<'a> {
        Moved { view, state }
    }
}

impl State {
    fn moved(&self, step: [f64; PARAMETERS], unit: f64) -> State {
        let [a, b, c, x, y, z, scale] = step;
        State {
            camera: self.camera.moved([a, b, c, x * unit, y * unit, z * unit]),
            scale_log: self.scale_log + scale,
        }
    }
}

/// Refines cameras and depth scales, and keeps the result only where it lowers the residual by more
/// than cameras gain that are right.
pub fn adjust(maps: &[DepthMap]) -> Adjusted {
    let as_it_was = |residual| Adjusted {
        maps: maps.to_vec(),
        residual: [residual; 2],
        kept: false,
    };
    let Some(unit) = median_depth(maps).filter(|_| maps.len() >= 2) else {
        return as_it_was(0.0);
    };
    let initial: Vec<State> = maps
        .iter()
        .map(|map| State {
            camera: map.camera.clone(),
            scale_log: 0.0,
        })
        .collect();
    let mut states = initial.clone();
    for blur in BLURS {
        let problem = Problem::new(maps, blur, 0, unit);
        let (mut damping, mut cost) = (1e-3, problem.cost(&states, &initial));
        for _ in 0..STEPS {
            let (normal, gradient) = problem.normal(&states, &initial);
            let Some(next) = problem.step(&states, &normal, &gradient, damping) else {
                break;
            };
            let next_cost = problem.cost(&next, &initial);
            if next_cost < cost {
                let gain = (cost - next_cost) / cost;
                (states, cost, damping) = (next, next_cost, damping * 0.3);
                if gain < LEAST_GAIN {
                    break;
                }
            } else {
                damping *= 10.0;
            }
        }
    }
    let held_out = Problem::new(maps, 1, 1, unit);
    let residual = [&initial, &states].map(|states| held_out.residual(states));
    let is_lower = residual[1] <= (1.0 - LEAST_FALL) * residual[0];
    if !is_lower {
        return Adjusted {
            residual,
            ..as_it_was(residual[0])
        };
    }
    let refined = maps.iter().zip(states).map(|(map, state)| {
        let scale = state.scale_log.exp() as f32;
        DepthMap {
            camera: state.camera,
            depth: map.depth.iter().map(|depth| depth * scale).collect(),
            ..map.clone()
        }
    });
    Adjusted {
        maps: refined.collect(),
        residual,
        kept: true,
    }
}

fn median_depth(maps: &[DepthMap]) -> Option<f64> {
    let depths = maps.iter().flat_map(|map| &map.depth).copied();
    let mut depths: Vec<f32> = depths.filter(|d| *d > 0.0 && d.is_finite()).collect();
    let middle = depths.len() / 2;
    (!depths.is_empty())
        .then(|| f64::from(*depths.select_nth_unstable_by(middle, f32::total_cmp).1))
}

/// The residuals at one blur.
struct Problem<'a> {
    maps: &'a [DepthMap],
    lumas: Vec<Luma>,
    /// Pixels of each view.
    samples: Vec<Vec<(usize, usize)>>,
    depth_size: f64,
    unit: f64,
}

type Steps = [[f64; PARAMETERS]; PARAMETERS];

impl<'a> Problem<'a> {
    /// Sets the problem up for one blur; `phase` 0 and 1 take different sample pixels.
    fn new(maps: &'a [DepthMap], blur: usize, phase: usize, unit: f64) -> Problem<'a> {
        let samples = |map: &DepthMap| {
            let (w, h) = (map.camera.width as usize, map.camera.height as usize);
            let stride = (((w * h) as f64 / SAMPLES as f64).sqrt() as usize).max(2);
            let first = stride / 4 + phase * (stride / 2);
            let rows = (first..h).step_by(stride);
            let pixels = rows.flat_map(|y| (first..w).step_by(stride).map(move |x| (x, y)));
            pixels
                .filter(|(x, y)| map.at(*x, *y).is_some_and(|d| !is_edge(map, *x, *y, d)))
                .collect()
        };
        Problem {
            maps,
            lumas: maps.iter().map(|map| Luma::new(map, blur)).collect(),
            samples: maps.iter().map(samples).collect(),
            depth_size: DEPTH_SIZE * blur as f64,
            unit,
        }
    }

    /// Returns ordered pairs of views.
    fn pairs(&self) -> Vec<(usize, usize)> {
        let n = self.maps.len();
        (0..n)
            .flat_map(|i| (0..n).filter(move |j| *j != i).map(move |j| (i, j)))
            .collect()
    }

    /// Returns depth and brightness of a sample of view `from` against view `to`, in units of their
    /// sizes; `None` if `to` does not see it.
    fn residuals(
        &self,
        from: Moved<'_>,
        to: Moved<'_>,
        (x, y): (usize, usize),
    ) -> Option<[f64; 2]> {
        let (i, j) = (from.view, to.view);
        let map = &self.maps[i];
        let depth = map.at(x, y)? * from.state.scale_log.exp();
        let moved = DepthMap::point_of(&from.state.camera, x, y, depth);
        let (place, z) = to.state.camera.project(moved);
        if z <= 0.0 {
            return None;
        }
        let seen = interpolated(&self.maps[j], place)?;
        let brightness = self.lumas[j].at(place)?
            - self.lumas[i].at(DVec2::new(x as f64 + 0.5, y as f64 + 0.5))?;
        Some([
            (z.ln() - seen.ln() - to.state.scale_log) / self.depth_size,
            brightness / BRIGHTNESS_SIZE,
        ])
    }

    /// Returns the mean robust residual; what is not seen counts as the worst.
    fn residual(&self, states: &[State]) -> f64 {
        let sums = self.pairs().into_par_iter().map(|(i, j)| {
            let costs = self.samples[i].iter().map(|sample| {
                let (from, to) = (Moved::new(i, &states[i]), Moved::new(j, &states[j]));
                match self.residuals(from, to, *sample) {
                    Some(residuals) => residuals.iter().map(|r| r * r / (1.0 + r * r)).sum::<f64>(),
                    None => 2.0,
                }
            });
            (costs.sum::<f64>(), 2 * self.samples[i].len())
        });
        // In the pairs' order, whatever the threads did.
        let sums: Vec<(f64, usize)> = sums.collect();
        let (cost, n) = sums.iter().fold((0.0, 0), |(a, b), (c, d)| (a + c, b + d));
        cost / n.max(1) as f64
    }

    fn n_residuals(&self) -> f64 {
        let n: usize = self.samples.iter().map(Vec::len).sum();
        (2 * n * (self.maps.len() - 1)).max(1) as f64
    }

    /// Returns the cost: robust residuals and a prior on how far views are off.
    fn cost(&self, states: &[State], initial: &[State]) -> f64 {
        let offs = states.iter().zip(initial).flat_map(|(state, first)| {
            let off = self.off(state, first);
            (0..PARAMETERS).map(move |k| (off[k] / EXPECTED[k / 3]).powi(2))
        });
        self.residual(states) * self.n_residuals() + PRIOR_SAMPLES * offs.sum::<f64>()
    }

    /// Returns how far a view is from where it began: turn, shift in median depths, scale.
    fn off(&self, state: &State, first: &State) -> [f64; PARAMETERS] {
        let turn =
            glam::DQuat::from_mat3(&(state.camera.rotation * first.camera.rotation.transpose()));
        let turn = turn.to_scaled_axis();
        let shift =
            first.camera.rotation * (first.camera.center() - state.camera.center()) / self.unit;
        [
            turn.x,
            turn.y,
            turn.z,
            shift.x,
            shift.y,
            shift.z,
            state.scale_log - first.scale_log,
        ]
    }

    /// Returns half of the cost's curvature and slope by all views' parameters.
    fn normal(&self, states: &[State], initial: &[State]) -> (DMatrix<f64>, DVector<f64>) {
        let mut steps: Steps = [[0.0; PARAMETERS]; PARAMETERS];
        for (k, step) in steps.iter_mut().enumerate() {
            step[k] = DIFFERENCE;
        }
        let variants: Vec<Vec<State>> = states
            .iter()
            .map(|state| {
                steps
                    .iter()
                    .map(|step| state.moved(*step, self.unit))
                    .collect()
            })
            .collect();
        let parts: Vec<_> = self
            .pairs()
            .into_par_iter()
            .map(|(i, j)| self.pair_normal(states, &variants, (i, j)))
            .collect();
        let n = PARAMETERS * states.len();
        let (mut normal, mut gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for ((i, j), (curvature, slope)) in self.pairs().into_iter().zip(parts) {
            let place = |k: usize| {
                if k < PARAMETERS {
                    i * PARAMETERS + k
                } else {
                    j * PARAMETERS + k - PARAMETERS
                }
            };
            for a in 0..2 * PARAMETERS {
                gradient[place(a)] += slope[a];
                for b in 0..2 * PARAMETERS {
                    normal[(place(a), place(b))] += curvature[a][b];
                }
            }
        }
        for (view, (state, first)) in states.iter().zip(initial).enumerate() {
            let off = self.off(state, first);
            for k in 0..PARAMETERS {
                let weight = PRIOR_SAMPLES / EXPECTED[k / 3].powi(2);
                normal[(view * PARAMETERS + k, view * PARAMETERS + k)] += weight;
                gradient[view * PARAMETERS + k] += weight * off[k];
            }
        }
        (normal, gradient)
    }

    fn pair_normal(
        &self,
        states: &[State],
        variants: &[Vec<State>],
        (i, j): (usize, usize),
    ) -> (
        [[f64; 2 * PARAMETERS]; 2 * PARAMETERS],
        [f64; 2 * PARAMETERS],
    ) {
        let mut curvature = [[0.0; 2 * PARAMETERS]; 2 * PARAMETERS];
        let mut slope = [0.0; 2 * PARAMETERS];
        for sample in &self.samples[i] {
            let at = |from: &State, to: &State| {
                self.residuals(Moved::new(i, from), Moved::new(j, to), *sample)
            };
            let Some(base) = at(&states[i], &states[j]) else {
                continue;
            };
            let mut jacobian = [[0.0; 2]; 2 * PARAMETERS];
            let mut whole = true;
            for (k, column) in jacobian.iter_mut().enumerate() {
                let moved = match k.checked_sub(PARAMETERS) {
                    None => at(&variants[i][k], &states[j]),
                    Some(k) => at(&states[i], &variants[j][k]),
                };
                match moved {
                    Some(moved) => *column = [0, 1].map(|r| (moved[r] - base[r]) / DIFFERENCE),
                    None => whole = false,
                }
            }
            if !whole {
                continue;
            }
            for r in 0..2 {
                // Geman and McClure's weight.
                let weight = 1.0 / (1.0 + base[r] * base[r]).powi(2);
                for a in 0..2 * PARAMETERS {
                    let weighted = weight * jacobian[a][r];
                    slope[a] += weighted * base[r];
                    for b in 0..2 * PARAMETERS {
                        curvature[a][b] += weighted * jacobian[b][r];
                    }
                }
            }
        }
        (curvature, slope)
    }

    /// Returns the views after a damped step; the first one's pose stays.
    fn step(
        &self,
        states: &[State],
        normal: &DMatrix<f64>,
        gradient: &DVector<f64>,
        damping: f64,
    ) -> Option<Vec<State>> {
        let n = normal.nrows() - POSE;
        let mut free = normal.view((POSE, POSE), (n, n)).into_owned();
        for k in 0..n {
            free[(k, k)] *= 1.0 + damping;
        }
        let step = free.cholesky()?.solve(&(-gradient.rows(POSE, n)));
        let whole = [&[0.0; POSE], step.as_slice()].concat();
        let steps = whole.as_chunks().0.iter();
        let next = states
            .iter()
            .zip(steps)
            .map(|(state, step)| state.moved(*step, self.unit));
        Some(next.collect())
    }
}
