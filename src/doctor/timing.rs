//! Times of the stages, the fastest of several rounds.

use std::collections::BTreeMap;
use std::time::Instant;

use super::rig::{Context, Rig};
use super::view::{TIMED_GAUSSIANS, TIMED_SIZE, ViewCase};
use super::{adam, changes, exchange, loss, stage};
use crate::doctor::twin::random::Random;
use crate::error::Result;
use crate::gpu::{Commands, Profile, Rasterizer, exp2};
use crate::render::{
    DepthKernels, DepthLossKind, DepthLossUniform, DepthPass, DepthPlane, DepthSize, LossUniform,
    Pass, PoseGradient, read_totals,
};
use crate::train::optimizer::StepUniform;

/// Rounds of which the fastest counts, unless another number is asked for.
pub const ROUNDS: u32 = 5;

/// The time of a stage.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// Name of the stage.
    pub stage: &'static str,
    /// How many of `unit` it worked on.
    pub count: usize,
    /// The things that `count` counts.
    pub unit: &'static str,
    /// Time that all of them took, seconds.
    pub seconds: f64,
    /// Whether it is by the adapter's timestamps; otherwise it is wall-clock time around submission
    /// and wait.
    pub by_timestamps: bool,
}

impl Timing {
    /// Makes the timing of a stage whose time a [`Clock`] has taken.
    pub fn wall(stage: &'static str, count: usize, unit: &'static str, seconds: f64) -> Timing {
        Timing {
            stage,
            count,
            unit,
            seconds,
            by_timestamps: false,
        }
    }
}

/// A wall clock that runs since its start.
pub struct Clock(Instant);

impl Clock {
    /// Starts a clock now.
    pub fn start() -> Clock {
        Clock(Instant::now())
    }

    /// Returns the time since the start, seconds.
    pub fn seconds(&self) -> f64 {
        self.0.elapsed().as_secs_f64()
    }
}

/// Times submissions, and keeps the shortest time of each stage.
struct Stopwatch<'a> {
    ctx: &'a Context,
    profile: Option<Profile>,
    best: BTreeMap<&'static str, f64>,
}

impl<'a> Stopwatch<'a> {
    fn new(ctx: &'a Context) -> Stopwatch<'a> {
        Stopwatch {
            ctx,
            profile: Profile::new(&ctx.gpu),
            best: BTreeMap::new(),
        }
    }

    /// Submits what `record` records, and returns its seconds.
    fn run(&mut self, record: impl FnOnce(&mut Commands<'_>)) -> Result<f64> {
        let gpu = &self.ctx.gpu;
        gpu.wait()?;
        let clock = Clock::start();
        let mut commands = Commands::profiled(gpu, self.profile.as_mut());
        record(&mut commands);
        commands.submit();
        gpu.wait()?;
        let wall = clock.seconds();
        match &mut self.profile {
            Some(profile) => Ok(profile.take(gpu)?.values().map(|k| k.seconds).sum()),
            None => Ok(wall),
        }
    }

    fn keep(&mut self, stage: &'static str, seconds: f64) {
        let best = self.best.entry(stage).or_insert(f64::INFINITY);
        *best = best.min(seconds);
    }

    fn timing(&self, stage: &'static str, count: usize, unit: &'static str) -> Timing {
        Timing {
            stage,
            count,
            unit,
            seconds: self.best.get(stage).copied().unwrap_or(f64::NAN),
            by_timestamps: self.profile.is_some(),
        }
    }
}

/// A stage and how it is recorded.
type Step = (&'static str, fn(&Pass<'_>, &mut Commands<'_>));

/// Times the stages of a view. The sort by tile stands for both sorts, counting and emitting pairs are
/// one stage.
fn steps(rasterizer: Rasterizer) -> [Step; 12] {
    let own = stage::own(rasterizer);
    [
        (stage::PROJECT, |pass, commands| pass.project(commands)),
        ("", |pass, commands| pass.sort_by_depth(commands)),
        (own.bin, |pass, commands| pass.count_pairs(commands)),
        (own.scan, |pass, commands| pass.scan_pairs(commands)),
        (own.bin, |pass, commands| pass.emit_pairs(commands)),
        (own.radix_sort, |pass, commands| pass.sort_by_tile(commands)),
        (stage::TILE_RANGES, |pass, commands| {
            pass.find_tile_ranges(commands)
        }),
        (stage::TILE_ORDER, |pass, commands| {
            pass.order_tiles(commands)
        }),
        (own.rasterize, |pass, commands| pass.rasterize(commands)),
        (own.rasterize_backward, |pass, commands| {
            pass.rasterize_backward(commands)
        }),
        (stage::SUM_PAIRS, |pass, commands| pass.sum_pairs(commands)),
        (stage::PROJECT_BACKWARD, |pass, commands| {
            pass.project_backward(commands)
        }),
    ]
}

/// A stage of depths and normals and how it is recorded.
type DepthStep = (
    &'static str,
    fn(&Pass<'_>, &mut Commands<'_>, &DepthKernels, &DepthPass),
);

/// Times the stages of depths and normals, between the colours' forward and backward.
fn depth_steps(rasterizer: Rasterizer) -> [DepthStep; 5] {
    let own = stage::own(rasterizer);
    [
        (stage::PROJECT_DEPTH, |pass, commands, kernels, depth| {
            pass.project_depth(commands, kernels, depth);
        }),
        (own.rasterize_depth, |pass, commands, kernels, depth| {
            pass.rasterize_depth(commands, kernels, depth);
        }),
        (stage::DEPTH_LOSS, |pass, commands, kernels, depth| {
            pass.depth_loss(commands, kernels, depth, DepthLossKind::Pearson);
        }),
        (
            own.rasterize_depth_backward,
            |pass, commands, kernels, depth| {
                pass.rasterize_depth_backward(commands, kernels, depth);
            },
        ),
        (
            stage::PROJECT_DEPTH_BACKWARD,
            |pass, commands, kernels, depth| {
                pass.project_depth_backward(commands, kernels, depth);
            },
        ),
    ]
}

/// Times the stages of a view, and returns the seconds of all together, forward and backward, too.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn time_view(ctx: &Context, case: &ViewCase, rounds: u32) -> Result<(Vec<Timing>, f64)> {
    let rasterizer = ctx.kernels.rasterizer;
    let own = stage::own(rasterizer);
    let mut rig = Rig::of_twin(ctx, &case.gaussians, &case.camera)?;
    rig.forward(ctx)?;
    let n_pairs = read_totals(&ctx.gpu, &rig.workspace)?.pairs;
    let n_pixels = case.camera.width * case.camera.height;
    let mut random = Random::new(9);
    let weights: Vec<f64> = (0..4 * n_pixels)
        .map(|_| random.uniform(-1.0, 1.0))
        .collect();
    let (d_rgb, d_alpha) = weights.split_at(3 * n_pixels);
    rig.write_image(ctx, "d_rendered", d_rgb, d_alpha, 0.0);
    let pose = PoseGradient::new(&ctx.gpu, &ctx.pose, &rig.workspace, &rig.model)?;
    let size = DepthSize {
        normals: true,
        patch_px: 64,
    };
    let views = [rig.view];
    let (gpu, kernels) = (&ctx.gpu, &ctx.depth);
    let depth = DepthPass::new(gpu, kernels, &rig.workspace, &rig.model, &views, size)?;
    depth.set_target(gpu, &vec![1.0; size.n_planes() * 4 * rig.view.plane_len()]);
    depth.set_loss(
        gpu,
        DepthLossUniform {
            weight: 1.0,
            patch_weight: 1.0,
            normal_weight: 1.0,
            kind: DepthLossKind::Pearson as u32,
            plane: DepthPlane::Expected as u32,
            inverse: 0,
            patch_vectors: size.patch_vectors(),
            normals: 1,
        },
    );
    let mut watch = Stopwatch::new(ctx);
    let mut least = f64::INFINITY;
    for _ in 0..rounds {
        let pass = rig.pass(ctx);
        let mut round: BTreeMap<&str, f64> = BTreeMap::new();
        for (stage, record) in steps(rasterizer) {
            let seconds = watch.run(|commands| record(&pass, commands))?;
            *round.entry(stage).or_insert(0.0) += seconds;
        }
        least = least.min(round.values().sum());
        let moved = watch.run(|commands| pass.pose_backward(commands, &ctx.pose, &pose))?;
        round.insert(stage::POSE_BACKWARD, moved);
        // The splats' gradients lie in the splats' place.
        watch.run(|commands| {
            pass.forward(commands);
            pass.rasterize_backward(commands);
        })?;
        for (stage, record) in depth_steps(rasterizer) {
            let seconds = watch.run(|commands| record(&pass, commands, &ctx.depth, &depth))?;
            round.insert(stage, seconds);
        }
        for (stage, seconds) in round {
            watch.keep(stage, seconds);
        }
    }
    let n = case.gaussians.n();
    let timings = [
        (stage::PROJECT, n, "Gaussians"),
        (own.radix_sort, n_pairs, "pairs"),
        (own.bin, n_pairs, "pairs"),
        (own.scan, n, "Gaussians"),
        (stage::TILE_RANGES, n_pairs, "pairs"),
        (
            stage::TILE_ORDER,
            rasterizer.n_tiles(rig.view.size),
            "tiles",
        ),
        (own.rasterize, n_pairs, "pairs"),
        (own.rasterize_backward, n_pairs, "pairs"),
        (stage::SUM_PAIRS, n_pairs, "pairs"),
        (stage::PROJECT_BACKWARD, n, "Gaussians"),
        (stage::POSE_BACKWARD, n, "Gaussians"),
        (stage::PROJECT_DEPTH, n, "Gaussians"),
        (own.rasterize_depth, n_pairs, "pairs"),
        (stage::DEPTH_LOSS, n_pixels, "pixels"),
        (own.rasterize_depth_backward, n_pairs, "pairs"),
        (stage::PROJECT_DEPTH_BACKWARD, n, "Gaussians"),
    ]
    .map(|(stage, count, unit)| watch.timing(stage, count, unit));
    Ok((timings.to_vec(), least))
}

/// Times the losses, and returns the seconds of one without a mask, too.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn time_losses(ctx: &Context, rounds: u32) -> Result<(Vec<Timing>, f64)> {
    let own = stage::own(ctx.kernels.rasterizer);
    let mut watch = Stopwatch::new(ctx);
    let n_pixels = TIMED_SIZE.0 * TIMED_SIZE.1;
    let rig = loss::rig(ctx, TIMED_SIZE)?;
    let goal = vec![0xff80_8080; n_pixels];
    rig.workspace.set_goal(&ctx.gpu, 0, &rig.view, &goal);
    let kinds = [(own.loss, false), (own.masked_loss, true)];
    for _ in 0..rounds {
        for (stage, masked) in kinds {
            let uniform = LossUniform::new(1.0, loss::SSIM_WEIGHT, n_pixels as f64, masked);
            let pass = rig.pass(ctx);
            let seconds = watch.run(|commands| pass.loss(commands, uniform))?;
            watch.keep(stage, seconds);
        }
    }
    let [plain, masked] = kinds.map(|(stage, _)| watch.timing(stage, n_pixels, "pixels"));
    Ok((vec![plain, masked], plain.seconds))
}

/// Times Adam, what partners hand over, and the changes of the set.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn time_rest(ctx: &Context, rounds: u32) -> Result<Vec<Timing>> {
    let gpu = &ctx.gpu;
    let mut watch = Stopwatch::new(ctx);
    let n = TIMED_GAUSSIANS;
    let optimizer = changes::optimizer(ctx, n, n, 3)?;
    let space = adam::workspace(ctx, n)?;
    let groups = optimizer.bind(gpu, &ctx.optimizer, &space);
    let config = adam::config()?;
    for _ in 0..rounds {
        let step = StepUniform::new(&config, 0, 1.0, &adam::CENTERS);
        let seconds = watch.run(|commands| {
            optimizer.step(gpu, &ctx.optimizer, &groups, commands, step, 3);
        })?;
        watch.keep(stage::ADAM, seconds);
    }
    let mut timings = vec![watch.timing(stage::ADAM, n, "Gaussians")];
    let n_pixels = TIMED_SIZE.0 * TIMED_SIZE.1;
    let pair = exchange::Pair::new(ctx, TIMED_SIZE)?;
    for _ in 0..rounds {
        let seconds = watch.run(|commands| pair.hand_over(ctx, commands))?;
        watch.keep(stage::EXCHANGE, seconds);
    }
    timings.push(watch.timing(stage::EXCHANGE, n_pixels, "pixels"));
    let mut powers = f64::INFINITY;
    for _ in 0..rounds {
        let clock = Clock::start();
        exp2::worst_ulps(gpu, &ctx.powers)?;
        powers = powers.min(clock.seconds());
    }
    timings.push(Timing::wall(
        stage::EXP2,
        exp2::N_CHECKED,
        "exponents",
        powers,
    ));
    // Both submit themselves.
    let mut optimizer = optimizer;
    let plan = changes::random_plan(n, n, 3);
    let (mut rearrange, mut reset) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..rounds {
        let clock = Clock::start();
        optimizer.rearrange(gpu, &ctx.optimizer, &plan, true)?;
        rearrange = rearrange.min(clock.seconds());
        let clock = Clock::start();
        optimizer.reset_opacity(gpu, &ctx.optimizer, 0.3, f32::INFINITY);
        gpu.wait()?;
        reset = reset.min(clock.seconds());
    }
    timings.push(Timing::wall(stage::REARRANGE, n, "Gaussians", rearrange));
    timings.push(Timing::wall(stage::RESET_OPACITY, n, "Gaussians", reset));
    Ok(timings)
}
