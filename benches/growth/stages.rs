//! The stages of a view, timed one by one.

use gspotential::doctor::{Context, Rig};
use gspotential::error::Result;
use gspotential::gaussians::Gaussians;
use gspotential::gpu::{Commands, Profile};
use gspotential::render::{LossUniform, Pass, ViewUniform};

use super::clock::of_gpu;

/// The rasterizer among the stages.
pub(crate) const RASTERIZE: &str = "rasterize";

/// A stage and how it is recorded.
type Stage = (&'static str, fn(&Pass<'_>, &mut Commands<'_>));

const N_STAGES: usize = 11;

/// The stages of a view in an order in which each finds what it needs, but for the loss gradient,
/// which is 0.
const STAGES: [Stage; N_STAGES] = [
    ("project", |pass, commands| pass.project(commands)),
    ("sort by depth", |pass, commands| {
        pass.sort_by_depth(commands);
    }),
    ("counting pairs", |pass, commands| {
        pass.count_pairs(commands);
        pass.scan_pairs(commands);
    }),
    ("emitting pairs", |pass, commands| pass.emit_pairs(commands)),
    ("sort by tile", |pass, commands| pass.sort_by_tile(commands)),
    ("tile ranges and order", |pass, commands| {
        pass.find_tile_ranges(commands);
        pass.order_tiles(commands);
    }),
    (RASTERIZE, |pass, commands| pass.rasterize(commands)),
    ("loss and its gradient", |pass, commands| {
        pass.loss(commands, LossUniform::new(0.0, 0.2, 1.0, false));
    }),
    ("rasterize backward", |pass, commands| {
        pass.rasterize_backward(commands);
    }),
    ("sum pairs", |pass, commands| pass.sum_pairs(commands)),
    ("project backward", |pass, commands| {
        pass.project_backward(commands)
    }),
];

/// One view.
pub(crate) struct Timed {
    /// (tile, Gaussian) pairs that its tiles list.
    pub pairs: f64,
    /// Seconds of the stages.
    pub stages: [(&'static str, f64); N_STAGES],
}

/// Renders `gaussians` in `view` and times all stages.
///
/// # Errors
/// A GPU fault.
pub(crate) fn measure(
    ctx: &Context,
    gaussians: &Gaussians,
    view: ViewUniform,
    rounds: u32,
) -> Result<Timed> {
    let mut rig = Rig::new(ctx, gaussians, view, gaussians.sh_degree)?;
    rig.forward(ctx)?;
    let n_tiles = ctx.kernels.rasterizer.n_tiles(view.size);
    let ranges: Vec<[u32; 2]> = rig.read(ctx, "tile_ranges", n_tiles)?;
    let mut profile = Profile::new(&ctx.gpu);
    let mut stages = STAGES.map(|(stage, _)| (stage, f64::INFINITY));
    for _ in 0..rounds.max(1) {
        for ((_, least), (_, record)) in stages.iter_mut().zip(STAGES) {
            let pass = rig.pass(ctx);
            let seconds = of_gpu(&ctx.gpu, &mut profile, |commands| {
                record(&pass, commands);
            })?;
            *least = least.min(seconds);
        }
    }
    Ok(Timed {
        pairs: ranges.iter().map(|r| f64::from(r[1] - r[0])).sum(),
        stages,
    })
}
