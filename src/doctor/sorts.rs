//! Sorts of more entries than the small views have: digits are counted and scanned over many blocks.

use super::finding::Findings;
use super::forward::sorted;
use super::rig::{Context, Rig, gaussians_of, view_of};
use super::stage;
use super::twin::cases::{cameras, random_scene};
use super::twin::random::Random;
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::Commands;

/// Entries of three blocks of a sort by workgroups, the last of them not full.
pub const BLOCKS: usize = 2500;

/// Gaussians that [`rig`] repeats.
const FEW: usize = 64;

/// Makes a rig with room for `n` Gaussians, whatever they are.
///
/// # Errors
/// A case that the adapter cannot hold.
pub fn rig(ctx: &Context, n: usize) -> Result<Rig> {
    let few = gaussians_of(&random_scene(FEW, 0, 3).gaussians, 0);
    let again = || (0..n).map(|i| i % FEW);
    let gaussians = Gaussians {
        means: again().map(|i| few.means[i]).collect(),
        scales_log: again().map(|i| few.scales_log[i]).collect(),
        rotations_wxyz: again().map(|i| few.rotations_wxyz[i]).collect(),
        opacity_logits: again().map(|i| few.opacity_logits[i]).collect(),
        sh: again()
            .flat_map(|i| few.sh[3 * i..][..3].to_vec())
            .collect(),
        sh_degree: 0,
    };
    Rig::new(ctx, &gaussians, view_of(&cameras()[0]), 0)
}

/// Sorts `n` entries by depth, and holds them to a stable sort.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn examine(ctx: &Context, n: usize) -> Result<Findings> {
    let mut out = Findings::of(format!("{n} entries"));
    let rig = rig(ctx, n)?;
    let mut random = Random::new(n as u64);
    // Few keys, so that many are equal, but of all digits.
    let step = u32::MAX / 37;
    let entries: Vec<[u32; 2]> = (0..n as u32)
        .map(|i| [random.uniform(0.0, 37.0) as u32 * step, i])
        .collect();
    rig.start(ctx);
    rig.buffer("depth_order").write(&ctx.gpu, &entries);
    let mut commands = Commands::new(&ctx.gpu);
    rig.pass(ctx).sort_by_depth(&mut commands);
    commands.submit();
    let order: Vec<[u32; 2]> = rig.read(ctx, "depth_order", n)?;
    let own = stage::own(ctx.kernels.rasterizer);
    out.equal((own.radix_sort, "many by depth"), &order, &sorted(&entries));
    Ok(out)
}
