//! Checks that two trainings with one seed end in the same bits on this adapter.

use serde::Serialize;

use super::rig::Context;
use crate::config::Config;
use crate::error::Result;
use crate::files::digest::sha256;
use crate::gaussians::Gaussians;
use crate::pipeline::{Prepared, prepare};
use crate::run::Seconds;
use crate::scene::builtin::{BuiltinOptions, scene};
use crate::train::train;

/// Two runs of one training, compared.
#[derive(Clone, Debug, Serialize)]
pub struct Repeat {
    /// Iterations of each run.
    pub iterations: u32,
    /// Gaussians at the end.
    pub n_gaussians: usize,
    /// Digests of every parameter's bits, one a run, 16 hex digits each.
    pub hashes: [String; 2],
    /// Whether both digests are equal.
    pub holds: bool,
}

/// Returns the paper's method with everything happening early, for a tiny image of the built-in
/// scene.
fn config() -> Result<Config> {
    let mut config = Config::preset("paper")?;
    config.iterations = 60;
    config.scene.max_points = Some(400);
    config.field.n_candidates = 256;
    config.views.count = 5;
    config.model.sh_interval = 12;
    config.densify.start = 10;
    config.densify.end = 50;
    config.densify.interval = 10;
    config.densify.opacity_reset_interval = 35;
    config.coverage.start = 30;
    config.coverage.interval = 10;
    config.validate()?;
    Ok(config)
}

/// Trains twice with one seed and compares.
///
/// # Errors
/// A GPU fault.
pub fn repeat(ctx: &Context) -> Result<Repeat> {
    let config = config()?;
    let scene = scene(&BuiltinOptions {
        width: 56,
        n_test: 1,
        pixel_step: 2,
        ..BuiltinOptions::default()
    });
    let Prepared {
        supervision, start, ..
    } = prepare(&scene, &config, &mut Seconds::default())?;
    let run = || {
        let (gpu, kernels) = (&ctx.gpu, &ctx.kernels);
        train(gpu, kernels, &start, &supervision, &config, &mut ())
    };
    let (first, second) = (run()?.gaussians, run()?.gaussians);
    let hashes = [hash_of(&first), hash_of(&second)];
    Ok(Repeat {
        iterations: config.iterations,
        n_gaussians: first.len(),
        holds: hashes[0] == hashes[1],
        hashes,
    })
}

/// Returns the first digits of the digest of every parameter's bits.
fn hash_of(g: &Gaussians) -> String {
    let parts: [&[u8]; 5] = [
        bytemuck::cast_slice(&g.means),
        bytemuck::cast_slice(&g.opacity_logits),
        bytemuck::cast_slice(&g.scales_log),
        bytemuck::cast_slice(&g.rotations_wxyz),
        bytemuck::cast_slice(&g.sh),
    ];
    let mut digest = sha256(&parts.concat());
    digest.truncate(16);
    digest
}
