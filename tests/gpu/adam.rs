//! Adam on the GPU against its twin: geometry, and SH from the views' colour gradients by way of
//! the basis, which never exist as a whole on the GPU.

use gspotential::config::Config;
use gspotential::gaussians::Gaussians;
use gspotential::gpu::Commands;
use gspotential::render::{Capacity, Model, ViewUniform, Workspace};
use gspotential::train::optimizer::{Optimizer, StepUniform};
use gspotential::train::schedule::mean_rate;

use super::render::print;
use super::rig::{Context, assert_held, context, gaussians_of, view_of, wide};
use crate::twins::adam::TwinAdam;
use crate::twins::cases::{Random, random_scene};
use crate::twins::linalg::{Vec3, normalize, sub};
use crate::twins::{sh, tolerance};

const N: usize = 130;
const STEPS: u32 = 8;
const CENTERS: [[f32; 3]; 2] = [[1.5, -0.5, 0.25], [-0.75, 0.5, 2.0]];

/// Large rates, so that what is compared is the change and not the start.
fn config() -> Config {
    let mut config = Config::preset("paper").expect("a preset");
    config.iterations = 2 * STEPS;
    config.optimizer.mean_lr_start = 0.02;
    config.optimizer.mean_lr_end = 0.004;
    config.optimizer.sh_lr = 0.5;
    config.optimizer.opacity_lr = 0.3;
    config.optimizer.scale_lr = 0.2;
    config.optimizer.rotation_lr = 0.1;
    config
}

/// A workspace whose gradients the test writes itself.
pub fn workspace(ctx: &Context, stride: usize) -> Workspace {
    let view = view_of(&crate::twins::cases::cameras()[0]);
    let views: [ViewUniform; 1] = [view];
    Workspace::new(&ctx.gpu, Capacity::new(stride, 64, &views), true).expect("fits")
}

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

const CLASSES: [&str; 5] = ["means", "opacity", "scales", "rotations", "sh"];

/// Steps a model of degree `stored` with the active degree rising to it, over one or two views;
/// the geometry of Gaussians beyond `frozen_beyond` stays. Returns the errors of moments and
/// parameters.
fn hold(stored: u32, n_views: usize, frozen_beyond: f32) -> [f64; 3] {
    let config = config();
    let extent = 1.75;
    let case = random_scene(N, stored as usize, 80 + u64::from(stored));
    let start = gaussians_of(&case.gaussians, stored);
    let n_sh = (stored as usize + 1).pow(2);
    let stride = N + 7;

    let ctx = context();
    let gpu = &ctx.gpu;
    let model = Model::upload(gpu, &start, stride).expect("fits");
    let mut optimizer = Optimizer::new(gpu, model).expect("fits");
    optimizer.frozen_beyond = frozen_beyond;
    let space = workspace(&ctx, stride);
    let backward = space.backward.as_ref().expect("for training");
    let groups = optimizer.bind(gpu, &ctx.optimizer, &space);
    space.totals.write(gpu, &[0_u32; 4]);

    let twin_adam = TwinAdam {
        beta1: config.optimizer.beta1,
        beta2: config.optimizer.beta2,
        epsilon: config.optimizer.epsilon,
    };
    let mut twin = numbers(&start);
    let mut moments: [Vec<[f64; 2]>; 5] = twin.each_ref().map(|v| vec![[0.0; 2]; v.len()]);
    let mut random = Random::new(81 + u64::from(stored));
    for iteration in 0..STEPS {
        let degree = (iteration / 2).min(stored);
        let mut draw = |len: usize| -> Vec<f32> {
            (0..len).map(|_| (1e-3 * random.normal()) as f32).collect()
        };
        let geometry = draw(12 * stride);
        let mut color = draw(8 * stride);
        if n_views == 1 {
            // What an unused slot holds must not matter.
            color[4 * stride..].fill(7.0);
        }
        backward.d_geometry.write(gpu, &geometry);
        backward.d_color.write(gpu, &color);
        backward.screen.write(gpu, &vec![[0.0_f32; 2]; stride]);
        let step = StepUniform::new(&config, iteration, extent, &CENTERS[..n_views]);
        let mut commands = Commands::new(gpu);
        optimizer.step(gpu, &ctx.optimizer, &groups, &mut commands, (step, degree));
        commands.submit();

        let plane = |p: usize, i: usize, c: usize| f64::from(geometry[4 * (p * stride + i) + c]);
        let o = &config.optimizer;
        let rate = mean_rate(o, iteration, config.iterations, extent);
        let rates = [rate, o.opacity_lr, o.scale_lr, o.rotation_lr];
        let mut gradients: [Vec<f64>; 5] = [const { Vec::new() }; 5];
        for i in 0..N {
            gradients[0].extend((0..3).map(|c| plane(0, i, c)));
            gradients[1].push(plane(0, i, 3));
            gradients[2].extend((0..3).map(|c| plane(1, i, c)));
            gradients[3].extend((0..4).map(|c| plane(2, i, c)));
            let mean: Vec3 = std::array::from_fn(|c| twin[0][3 * i + c]);
            let mut coefficients = vec![[0.0; 3]; n_sh];
            for (v, center) in CENTERS[..n_views].iter().enumerate() {
                let (direction, _) = normalize(&sub(&mean, &center.map(f64::from)));
                let y = sh::basis(direction);
                for (k, coefficient) in coefficients.iter_mut().enumerate() {
                    if k < (degree as usize + 1).pow(2) {
                        for (c, value) in coefficient.iter_mut().enumerate() {
                            *value += y[k] * f64::from(color[4 * (v * stride + i) + c]);
                        }
                    }
                }
            }
            gradients[4].extend(coefficients.as_flattened());
        }
        let is_frozen: Vec<bool> = twin[0]
            .chunks_exact(3)
            .map(|m| m.iter().map(|x| x * x).sum::<f64>().sqrt() > f64::from(frozen_beyond))
            .collect();
        for class in 0..5 {
            let width = twin[class].len() / N;
            for j in 0..twin[class].len() {
                let rate = match class {
                    4 if (j / 3) % n_sh == 0 => o.sh_lr,
                    4 => o.sh_lr / 20.0,
                    _ if is_frozen[j / width] => 0.0,
                    _ => rates[class],
                };
                let moments = &mut moments[class][j];
                let t = iteration as i32 + 1;
                twin_adam.step(&mut twin[class][j], moments, gradients[class][j], rate, t);
            }
        }
    }

    let mut worst = [0.0f64; 3];
    let initial = numbers(&start);
    let ours = numbers(&optimizer.model.download(gpu).expect("readable"));
    let first = numbers(&optimizer.first_moment.download(gpu).expect("readable"));
    let second = numbers(&optimizer.second_moment.download(gpu).expect("readable"));
    for (class, name) in CLASSES.into_iter().enumerate() {
        let difference =
            |a: &[f64]| -> Vec<f64> { a.iter().zip(&initial[class]).map(|(a, b)| a - b).collect() };
        let moment = |m: usize| -> Vec<f64> { moments[class].iter().map(|v| v[m]).collect() };
        let name = format!("degree {stored}, {n_views} views: {name}");
        let bound = tolerance::GPU_ADAM;
        let (ours, twin) = (difference(&ours[class]), difference(&twin[class]));
        for (i, (what, ours, twin)) in [
            ("first moment", &first[class], &moment(0)),
            ("second moment", &second[class], &moment(1)),
            ("change", &ours, &twin),
        ]
        .into_iter()
        .enumerate()
        {
            let error = assert_held(&format!("{name}, {what}"), ours, twin, bound);
            worst[i] = worst[i].max(error);
        }
    }
    worst
}

#[test]
fn adam_matches_its_twin_at_every_degree_for_one_view_and_two() {
    for stored in 0..4 {
        for n_views in [1, 2] {
            let [m, v, p] = hold(stored, n_views, f32::MAX);
            print(&format!(
                "Adam, degree {stored}, {n_views} views: moments off by {m:.1e} and {v:.1e}, \
                 parameters by {p:.1e}\n"
            ));
        }
    }
}

#[test]
fn gaussians_beyond_the_frozen_distance_learn_colour_alone() {
    // About half of a ball of radius 0.8.
    hold(1, 2, 0.635);
}

#[test]
fn a_step_whose_pairs_did_not_fit_changes_nothing() {
    let ctx = context();
    let gpu = &ctx.gpu;
    let case = random_scene(N, 3, 90);
    let start = gaussians_of(&case.gaussians, 3);
    let model = Model::upload(gpu, &start, N).expect("fits");
    let optimizer = Optimizer::new(gpu, model).expect("fits");
    let space = workspace(&ctx, N);
    let backward = space.backward.as_ref().expect("for training");
    let groups = optimizer.bind(gpu, &ctx.optimizer, &space);
    backward.d_geometry.write(gpu, &vec![1.0_f32; 12 * N]);
    backward.d_color.write(gpu, &vec![1.0_f32; 8 * N]);
    backward.screen.write(gpu, &vec![[1.0_f32; 2]; N]);
    for (overflow, changes) in [(1_u32, false), (0, true)] {
        space.totals.write(gpu, &[9_u32, 9, overflow, 9]);
        let step = StepUniform::new(&config(), 0, 1.0, &CENTERS);
        let mut commands = Commands::new(gpu);
        optimizer.step(gpu, &ctx.optimizer, &groups, &mut commands, (step, 3));
        commands.submit();
        let after = optimizer.model.download(gpu).expect("readable");
        assert_eq!(after != start, changes);
        let statistics = optimizer.gather(gpu).expect("readable").statistics;
        let expected = if changes { [1.0; 3] } else { [0.0; 3] };
        assert!(statistics.iter().all(|s| *s == expected));
    }
}

#[test]
fn statistics_sum_gradients_and_views_and_keep_the_largest_radius() {
    let ctx = context();
    let gpu = &ctx.gpu;
    let start = gaussians_of(&random_scene(3, 0, 92).gaussians, 0);
    let optimizer =
        Optimizer::new(gpu, Model::upload(gpu, &start, 3).expect("fits")).expect("fits");
    let space = workspace(&ctx, 3);
    let backward = space.backward.as_ref().expect("for training");
    let groups = optimizer.bind(gpu, &ctx.optimizer, &space);
    space.totals.write(gpu, &[0_u32; 4]);
    backward.d_geometry.write(gpu, &[0.0_f32; 36]);
    backward.d_color.write(gpu, &[0.0_f32; 24]);
    // A radius of 0: not drawn.
    for screen in [
        [[1.0, 0.5], [0.25, 0.125], [3.0, 0.0]],
        [[2.0, 0.25], [0.0, 0.0], [5.0, 0.0]],
    ] {
        let screen: [[f32; 2]; 3] = screen;
        backward.screen.write(gpu, &screen);
        let step = StepUniform::new(&config(), 0, 1.0, &CENTERS);
        let mut commands = Commands::new(gpu);
        optimizer.step(gpu, &ctx.optimizer, &groups, &mut commands, (step, 0));
        commands.submit();
    }
    let statistics = optimizer.gather(gpu).expect("readable").statistics;
    assert_eq!(statistics, [[3.0, 2.0, 0.5], [0.25, 1.0, 0.125], [0.0; 3]]);
    // Without gradients nothing has moved.
    assert_eq!(optimizer.model.download(gpu).expect("readable"), start);
}
