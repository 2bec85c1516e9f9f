//! Changes of the set of Gaussians: a densification plan carried out, and the opacity reset.

use glam::Vec3;

use super::finding::Findings;
use super::rig::{Context, gaussians_of};
use super::stage;
use crate::doctor::twin::cases::random_scene;
use crate::doctor::twin::random::Random;
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::Gpu;
use crate::render::{BLOCK_PLANES, Model, n_blocks};
use crate::train::optimizer::Optimizer;
use crate::train::policy::{NEW, Plan};

/// Distance from the origin within which [`examine_reset`] resets: that of about two thirds of the
/// Gaussians.
pub const RESET_WITHIN: f32 = 0.7;

/// A number of Gaussians, and the number that there is room for.
#[derive(Clone, Copy, Debug)]
pub struct SetSize {
    /// Gaussians.
    pub n: usize,
    /// Room for Gaussians, at least `n`.
    pub stride: usize,
}

/// Fills a model with noise.
fn fill(gpu: &Gpu, model: &Model, seed: u64) {
    let mut random = Random::new(seed);
    let blocks = model.blocks.iter().zip(BLOCK_PLANES);
    for (buffer, planes) in blocks.take(n_blocks(model.sh_degree)) {
        let values: Vec<f32> = (0..4 * planes * model.stride)
            .map(|_| random.normal() as f32)
            .collect();
        buffer.write(gpu, &values);
    }
}

/// Draws a plan of `len` Gaussians out of `n`, two fifths of them new.
pub fn random_plan(n: usize, len: usize, seed: u64) -> Plan {
    let mut random = Random::new(seed);
    let mut plan = Plan::default();
    for _ in 0..len {
        let new = random.uniform(0.0, 1.0) < 0.4;
        let source = random.uniform(0.0, n as f64) as u32;
        plan.sources.push(if new { source | NEW } else { source });
        let change = [(); 4].map(|()| random.normal() as f32);
        plan.changes.push(if new { change } else { [0.0; 4] });
    }
    plan
}

/// Returns the set that a plan makes of `old`; moments of new Gaussians are 0.
fn carried_out(old: &Gaussians, plan: &Plan, moments: bool) -> Gaussians {
    let n_sh = 3 * old.n_sh();
    let mut new = Gaussians {
        sh_degree: old.sh_degree,
        ..Gaussians::default()
    };
    for (source, change) in plan.sources.iter().zip(&plan.changes) {
        let i = (source & !NEW) as usize;
        let factor = if moments && source & NEW != 0 {
            0.0
        } else {
            1.0
        };
        let [x, y, z, grow] = if moments { [0.0; 4] } else { *change };
        new.means.push(old.means[i] * factor + Vec3::new(x, y, z));
        new.scales_log
            .push(old.scales_log[i] * factor + Vec3::splat(grow));
        new.opacity_logits.push(old.opacity_logits[i] * factor);
        let rotation = old.rotations_wxyz[i].map(|q| q * factor);
        new.rotations_wxyz.push(rotation);
        let sh = &old.sh[i * n_sh..][..n_sh];
        new.sh.extend(sh.iter().map(|s| s * factor));
    }
    new
}

/// Makes an optimizer of `n` Gaussians with room for `stride`, and moments of noise.
///
/// # Errors
/// A case that the adapter cannot hold.
pub fn optimizer(ctx: &Context, n: usize, stride: usize, degree: u32) -> Result<Optimizer> {
    let gpu = &ctx.gpu;
    let start = gaussians_of(&random_scene(n, degree as usize, 95).gaussians, degree);
    let optimizer = Optimizer::new(gpu, Model::upload(gpu, &start, stride)?)?;
    fill(gpu, &optimizer.first_moment, 1);
    fill(gpu, &optimizer.second_moment, 2);
    Ok(optimizer)
}

fn download(ctx: &Context, optimizer: &Optimizer) -> Result<[Gaussians; 3]> {
    let download = |model: &Model| model.download(&ctx.gpu);
    Ok([
        download(&optimizer.model)?,
        download(&optimizer.first_moment)?,
        download(&optimizer.second_moment)?,
    ])
}

/// Counts floats whose bits differ.
fn n_different(a: &Gaussians, b: &Gaussians) -> usize {
    let bits = |g: &Gaussians| -> Vec<u32> {
        let xyz = |v: &[Vec3]| v.iter().flat_map(Vec3::to_array).collect::<Vec<f32>>();
        let classes = [
            xyz(&g.means),
            xyz(&g.scales_log),
            g.opacity_logits.clone(),
            g.rotations_wxyz.as_flattened().to_vec(),
            g.sh.clone(),
        ];
        // Zeros of either sign are one number.
        classes
            .iter()
            .flatten()
            .map(|x| (x + 0.0).to_bits())
            .collect()
    };
    let (a, b) = (bits(a), bits(b));
    a.len().abs_diff(b.len()) + a.iter().zip(&b).filter(|(a, b)| a != b).count()
}

/// Carries `plan` out on `n` Gaussians and compares to the bit, as the changes are one addition
/// each.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn examine_rearrange(
    ctx: &Context,
    plan: &Plan,
    set: SetSize,
    degree: u32,
) -> Result<Findings> {
    let SetSize { n, stride } = set;
    let len = plan.sources.len();
    let mut out = Findings::of(format!("{n} to {len} Gaussians of degree {degree}"));
    for kind in [(true, false), (false, false), (true, true), (false, true)] {
        let optimizer = optimizer(ctx, n, stride, degree)?;
        examine_one(ctx, plan, optimizer, kind, &mut out)?;
    }
    Ok(out)
}

/// Does so for a plan that densifies, after which statistics start anew but for the rates of
/// positions that have their own, or for one that does not.
fn examine_one(
    ctx: &Context,
    plan: &Plan,
    mut optimizer: Optimizer,
    (densifies, own_rates): (bool, bool),
    out: &mut Findings,
) -> Result<()> {
    let rate = if own_rates { 4.0 } else { 0.0 };
    let gathered: Vec<[f32; 4]> = (0..optimizer.model.n)
        .map(|i| [1.0, 2.0, 3.0, rate].map(|k: f32| k * (i + 1) as f32))
        .collect();
    let gains: Vec<f32> = gathered.iter().map(|g| g[3]).collect();
    optimizer.set_position_gains(&ctx.gpu, if own_rates { &gains } else { &[] });
    if let Some(statistics) = optimizer.buffers().last() {
        statistics.write(&ctx.gpu, &gathered);
    }
    let old = download(ctx, &optimizer)?;
    optimizer.rearrange(&ctx.gpu, &ctx.optimizer, plan, densifies)?;
    let new = download(ctx, &optimizer)?;
    for (which, what) in ["parameters", "first moments", "second moments"]
        .into_iter()
        .enumerate()
    {
        let expected = carried_out(&old[which], plan, which > 0);
        let n_wrong = n_different(&new[which], &expected);
        out.none((stage::REARRANGE, what), n_wrong);
    }
    let statistics: Vec<[f32; 4]> = match optimizer.buffers().last() {
        Some(statistics) => statistics.read(&ctx.gpu, plan.sources.len())?,
        None => Vec::new(),
    };
    let expected: Vec<[f32; 4]> = plan
        .sources
        .iter()
        .map(|source| {
            let [sum, n_views, radius, rate] = gathered[(source & !NEW) as usize];
            if densifies {
                [0.0, 0.0, 0.0, rate]
            } else {
                [sum, n_views, radius, rate]
            }
        })
        .collect();
    out.equal((stage::REARRANGE, "statistics"), &statistics, &expected);
    Ok(())
}

/// Resets the opacities of `n` Gaussians and compares: but for those far out they fall to the
/// ceiling, and their moments to zero.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn examine_reset(ctx: &Context, n: usize) -> Result<Findings> {
    let mut out = Findings::of(format!("{n} Gaussians"));
    let optimizer = optimizer(ctx, n, n + 5, 1)?;
    let mut expected = download(ctx, &optimizer)?;
    optimizer.reset_opacity(&ctx.gpu, &ctx.optimizer, 0.3, RESET_WITHIN);
    let ceiling = (0.3_f64 / 0.7).ln() as f32;
    for i in 0..n {
        let mean = expected[0].means[i].as_dvec3();
        if mean.length() <= f64::from(RESET_WITHIN) {
            let logit = &mut expected[0].opacity_logits[i];
            *logit = logit.min(ceiling);
            expected[1].opacity_logits[i] = 0.0;
            expected[2].opacity_logits[i] = 0.0;
        }
    }
    let after = download(ctx, &optimizer)?;
    let differ = after.iter().zip(&expected).map(|(a, b)| n_different(a, b));
    out.none(
        (stage::RESET_OPACITY, "parameters and moments"),
        differ.sum(),
    );
    Ok(out)
}
