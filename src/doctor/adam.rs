//! Adam: geometry, and SH from the views' colour gradients by way of the basis, which never exist
//! as a whole on the GPU.

use super::finding::Findings;
use super::rig::{Context, gaussians_of, view_of, wide};
use super::stage;
use crate::config::{Config, OptimizerConfig};
use crate::doctor::twin::adam::TwinAdam;
use crate::doctor::twin::cases::{cameras, random_scene};
use crate::doctor::twin::linalg::{Vec3, normalize, sub};
use crate::doctor::twin::random::Random;
use crate::doctor::twin::{sh, tolerance};
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::Commands;
use crate::render::{Capacity, Model, Workspace};
use crate::train::optimizer::{Optimizer, StepUniform};
use crate::train::schedule::mean_rate;

const N: usize = 130;
const STEPS: u32 = 8;
const EXTENT: f64 = 1.75;

/// Optical centres of a step's views, which `f32` cannot hold.
pub const CENTERS: [[f64; 3]; 2] = [[1.6, -0.55, 0.23], [-0.7, 0.51, 2.03]];

const CLASSES: [&str; 5] = ["means", "opacity", "scales", "rotations", "SH"];

/// Returns a config of large rates, so that what is compared is the change and not the start.
///
/// # Errors
/// None in practice: the preset is the program's own.
pub fn config() -> Result<Config> {
    let mut config = Config::preset("paper")?;
    config.iterations = 2 * STEPS;
    config.optimizer = OptimizerConfig {
        mean_lr_start: 0.02,
        mean_lr_end: 0.004,
        sh_lr: 0.5,
        opacity_lr: 0.3,
        scale_lr: 0.2,
        rotation_lr: 0.1,
        ..config.optimizer
    };
    Ok(config)
}

/// Makes a workspace whose gradients are written by hand.
///
/// # Errors
/// As [`Workspace::new`].
pub fn workspace(ctx: &Context, stride: usize) -> Result<Workspace> {
    let view = view_of(&cameras()[0]);
    let capacity = Capacity::new(ctx.kernels.rasterizer, stride, 64, &[view]);
    Workspace::new(&ctx.gpu, capacity, true)
}

/// Returns parameters or moments by class.
fn numbers(g: &Gaussians) -> [Vec<f64>; 5] {
    let xyz = |v: &[glam::Vec3]| v.iter().flat_map(|v| v.to_array().map(f64::from)).collect();
    [
        xyz(&g.means),
        wide(&g.opacity_logits),
        xyz(&g.scales_log),
        wide(g.rotations_wxyz.as_flattened()),
        wide(&g.sh),
    ]
}

/// Random numbers in place of what the backward passes of a step leave.
struct Drawn {
    stride: usize,
    geometry: Vec<f32>,
    color: Vec<f32>,
}

impl Drawn {
    fn new(random: &mut Random, stride: usize, n_views: usize) -> Drawn {
        let mut draw = |len: usize| -> Vec<f32> {
            (0..len).map(|_| (1e-3 * random.normal()) as f32).collect()
        };
        let geometry = draw(12 * stride);
        let mut color = draw(8 * stride);
        if n_views == 1 {
            // An unused slot must not matter, whatever it holds.
            color[4 * stride..].fill(7.0);
        }
        Drawn {
            stride,
            geometry,
            color,
        }
    }

    /// Returns the gradient by class; SH up to `degree` of the `n_sh` coefficients stored.
    fn gradients(&self, means: &[f64], n_views: usize, degree: u32, n_sh: usize) -> [Vec<f64>; 5] {
        let plane =
            |p: usize, i: usize, c: usize| f64::from(self.geometry[4 * (p * self.stride + i) + c]);
        let mut gradients: [Vec<f64>; 5] = [const { Vec::new() }; 5];
        for (i, mean) in means.chunks_exact(3).enumerate() {
            gradients[0].extend((0..3).map(|c| plane(0, i, c)));
            gradients[1].push(plane(0, i, 3));
            gradients[2].extend((0..3).map(|c| plane(1, i, c)));
            gradients[3].extend((0..4).map(|c| plane(2, i, c)));
            let mean: Vec3 = [mean[0], mean[1], mean[2]];
            let mut coefficients = vec![[0.0; 3]; n_sh];
            for (v, center) in CENTERS[..n_views].iter().enumerate() {
                let (direction, _) = normalize(&sub(&mean, center));
                let color = &self.color[4 * (v * self.stride + i)..][..3];
                let active = (degree as usize + 1).pow(2);
                for (coefficient, y) in coefficients
                    .iter_mut()
                    .zip(sh::basis(direction))
                    .take(active)
                {
                    for (value, color) in coefficient.iter_mut().zip(color) {
                        *value += y * f64::from(*color);
                    }
                }
            }
            gradients[4].extend(coefficients.as_flattened());
        }
        gradients
    }
}

/// The reference's parameters and moments.
struct Twin {
    values: [Vec<f64>; 5],
    moments: [Vec<[f64; 2]>; 5],
}

impl Twin {
    fn step(
        &mut self,
        config: &Config,
        (iteration, n_sh): (u32, usize),
        gradients: &[Vec<f64>; 5],
        gains: &[f32],
    ) {
        let o = &config.optimizer;
        let adam = TwinAdam {
            beta1: o.beta1,
            beta2: o.beta2,
            epsilon: o.epsilon,
        };
        let mean = mean_rate(o, iteration, config.iterations, EXTENT);
        let rates = [mean, o.opacity_lr, o.scale_lr, o.rotation_lr];
        for (class, gradients) in gradients.iter().enumerate() {
            for (j, &gradient) in gradients.iter().enumerate() {
                let rate = match class {
                    4 if (j / 3).is_multiple_of(n_sh) => o.sh_lr,
                    4 => o.sh_lr / 20.0,
                    0 => mean * (1.0 + gains.get(j / 3).map_or(0.0, |gain| f64::from(*gain))),
                    _ => rates[class],
                };
                let value = &mut self.values[class][j];
                let moments = &mut self.moments[class][j];
                adam.step(value, moments, gradient, rate, iteration as i32 + 1);
            }
        }
    }

    /// Adds the gradient of the weighted mean least scale of the Gaussians that are drawn to that of the scales' logarithms.
    fn flatten(&self, weight: f64, gradients: &mut [f64]) {
        let each = self.values[2]
            .chunks_exact(3)
            .zip(gradients.chunks_exact_mut(3));
        for (i, (scales, gradients)) in each.enumerate() {
            let mut axis = 0;
            for other in [1, 2] {
                if scales[other] < scales[axis] {
                    axis = other;
                }
            }
            if radius(i) > 0.0 {
                gradients[axis] += weight / N as f64 * scales[axis].exp();
            }
        }
    }

    /// Puts back the geometry of what is frozen: `before` are the values before the step.
    fn freeze(&mut self, frozen_beyond: f32, before: &[Vec<f64>; 5]) {
        for (i, mean) in before[0].chunks_exact(3).enumerate() {
            let distance = mean.iter().map(|x| x * x).sum::<f64>().sqrt();
            if distance > f64::from(frozen_beyond) {
                for (class, width) in [3, 1, 3, 4].into_iter().enumerate() {
                    let own = i * width..(i + 1) * width;
                    self.values[class][own.clone()].copy_from_slice(&before[class][own]);
                }
            }
        }
    }
}

/// Weight of the mean least scale with which its gradient is about as large as the others.
pub const FLAT_WEIGHT: f64 = 5.0;

/// Returns the radius that Gaussian `i` is drawn with; 0: it is not.
fn radius(i: usize) -> f32 {
    if i.is_multiple_of(3) { 0.0 } else { 0.1 }
}

/// Distance from the origin that about half of the Gaussians lie beyond.
pub const FROZEN_BEYOND: f32 = 0.635;

/// The ways in which a step may treat Gaussians unlike one another.
#[derive(Clone, Copy, Debug)]
pub struct Treatment {
    /// Distance from the origin beyond which geometry stays as it is; infinite: nowhere.
    pub frozen_beyond: f32,
    /// Whether positions have rates of their own.
    pub own_rates: bool,
    /// Weight of the mean least scale; every third Gaussian is not drawn and has none.
    pub flat_weight: f64,
}

impl Treatment {
    /// Treats all alike.
    pub const ALIKE: Treatment = Treatment {
        frozen_beyond: f32::INFINITY,
        own_rates: false,
        flat_weight: 0.0,
    };
}

/// Steps a model of degree `stored`, the active degree rising to it, over one view or two, and
/// holds it to the reference.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn examine(
    ctx: &Context,
    stored: u32,
    n_views: usize,
    treatment: Treatment,
) -> Result<Findings> {
    let Treatment {
        frozen_beyond,
        own_rates,
        flat_weight,
    } = treatment;
    let gpu = &ctx.gpu;
    let mut config = config()?;
    config.loss.flat_weight = flat_weight;
    let case = random_scene(N, stored as usize, 80 + u64::from(stored));
    let mut start = gaussians_of(&case.gaussians, stored);
    if frozen_beyond.is_finite() {
        // It stays where it is, a ten-thousandth of the scene from a camera: an error of that place
        // would show ten-thousandfold in the direction.
        start.means[0] = CENTERS[0].map(|x| (x + 5e-5) as f32).into();
    }
    let n_sh = start.n_sh();
    let stride = N + 7;
    let mut optimizer = Optimizer::new(gpu, Model::upload(gpu, &start, stride)?)?;
    let gains: Vec<f32> = match own_rates {
        true => (0..N).map(|i| 0.05 * i as f32).collect(),
        false => Vec::new(),
    };
    optimizer.set_position_gains(gpu, &gains);
    let space = workspace(ctx, stride)?;
    let groups = optimizer.bind(gpu, &ctx.optimizer, &space);
    space.buffer("totals").write(gpu, &[0_u32; 4]);

    let initial = numbers(&start);
    let mut twin = Twin {
        moments: initial.each_ref().map(|v| vec![[0.0; 2]; v.len()]),
        values: initial.clone(),
    };
    let mut random = Random::new(81 + u64::from(stored));
    for iteration in 0..STEPS {
        let degree = (iteration / 2).min(stored);
        let drawn = Drawn::new(&mut random, stride, n_views);
        space.buffer("d_geometry").write(gpu, &drawn.geometry);
        space.buffer("d_color").write(gpu, &drawn.color);
        let screen: Vec<[f32; 2]> = (0..stride).map(|i| [0.0, radius(i)]).collect();
        space.buffer("screen").write(gpu, &screen);
        let step =
            StepUniform::new(&config, iteration, EXTENT, &CENTERS[..n_views]).within(frozen_beyond);
        let mut commands = Commands::new(gpu);
        optimizer.step(gpu, &ctx.optimizer, &groups, &mut commands, step, degree);
        commands.submit();
        let mut gradients = drawn.gradients(&twin.values[0], n_views, degree, n_sh);
        twin.flatten(flat_weight, &mut gradients[2]);
        let before = twin.values.clone();
        twin.step(&config, (iteration, n_sh), &gradients, &gains);
        twin.freeze(frozen_beyond, &before);
    }

    let frozen = match (frozen_beyond.is_finite(), own_rates) {
        (true, _) => ", some frozen",
        (false, true) => ", rates of their own",
        (false, false) if flat_weight > 0.0 => ", flattened",
        (false, false) => "",
    };
    let mut out = Findings::of(format!(
        "degree {stored}, {n_views} views, {STEPS} steps{frozen}"
    ));
    let download = |model: &Model| Ok(numbers(&model.download(gpu)?));
    let ours = download(&optimizer.model)?;
    let moments = [
        download(&optimizer.first_moment)?,
        download(&optimizer.second_moment)?,
    ];
    for (class, name) in CLASSES.into_iter().enumerate() {
        let change = |values: &[f64]| -> Vec<f64> {
            let pairs = values.iter().zip(&initial[class]);
            pairs.map(|(a, b)| a - b).collect()
        };
        let (ours, theirs) = (change(&ours[class]), change(&twin.values[class]));
        let bound = tolerance::GPU_ADAM;
        out.close(
            (stage::ADAM, &format!("{name}, change")),
            &ours,
            &theirs,
            bound,
        );
        for (m, which) in ["first moment", "second moment"].into_iter().enumerate() {
            let theirs: Vec<f64> = twin.moments[class].iter().map(|v| v[m]).collect();
            let what = format!("{name}, {which}");
            out.close((stage::ADAM, &what), &moments[m][class], &theirs, bound);
        }
    }
    Ok(out)
}
