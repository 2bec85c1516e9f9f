//! The losses of depths and normals and their gradients, each kind on the depths of a view.

use super::bounds::Bounds;
use super::finding::Findings;
use super::rig::{Context, Rig};
use super::stage;
use crate::doctor::twin::depth::{TwinDepth, TwinDepths};
use crate::doctor::twin::depth_loss::{
    TwinDepthKind, TwinDepthLoss, TwinDepthOf, TwinTarget, depth_loss_gradient, depth_losses,
};
use crate::doctor::twin::random::{Random, f32_exact};
use crate::doctor::twin::tolerance;
use crate::error::Result;
use crate::gpu::Commands;
use crate::render::{DepthLossKind, DepthLossUniform, DepthPass, DepthPlane, DepthSize};

/// Side of the patches of the loss, pixels.
const PATCH: u32 = 12;
/// Sizes of the buffers.
pub(super) const SIZE: DepthSize = DepthSize {
    normals: true,
    patch_px: PATCH,
};
/// Planes of `depths` that hold sums, normals, median, mode, alpha or its gradient, and transmittance.
pub(super) const N_VALUES: usize = 8;
/// The last of them.
pub(super) const TRANSMITTANCE: usize = 7;
/// Pixels whose 1 - transmittance is this close to the least that counts have no target.
const NEAR_HALF: f64 = 1e-3;

/// Fewest pixels, and least spread of their depths, that losses are compared with: with less, scale and shift
/// are rounding's.
const LEAST_COVERED: usize = 100;
const LEAST_SPREAD: f64 = 0.05;

/// Returns a pixel's numbers in the order of the planes; those of alpha are not compared.
pub(super) fn values(d: &TwinDepth) -> [f64; N_VALUES] {
    let [x, y, z] = d.normal;
    [d.sum, x, y, z, d.median, d.mode, d.alpha, 1.0 - d.alpha]
}

/// The losses that are held to the reference.
fn losses() -> [TwinDepthLoss; 4] {
    let pearson = TwinDepthLoss {
        kind: TwinDepthKind::Pearson,
        of: TwinDepthOf::Expected,
        inverse: false,
        weight: 0.5,
        patch_weight: 0.25,
        normal_weight: 0.125,
        patch: PATCH as usize,
    };
    [
        pearson,
        TwinDepthLoss {
            inverse: true,
            of: TwinDepthOf::Mode,
            ..pearson
        },
        TwinDepthLoss {
            kind: TwinDepthKind::ScaleShift,
            inverse: true,
            patch_weight: 0.0,
            ..pearson
        },
        TwinDepthLoss {
            kind: TwinDepthKind::L1,
            of: TwinDepthOf::Median,
            ..pearson
        },
    ]
}

fn uniform_of(loss: &TwinDepthLoss) -> (DepthLossUniform, DepthLossKind) {
    let kind = match loss.kind {
        TwinDepthKind::Pearson => DepthLossKind::Pearson,
        TwinDepthKind::ScaleShift => DepthLossKind::ScaleShift,
        TwinDepthKind::L1 => DepthLossKind::L1,
    };
    let plane = match loss.of {
        TwinDepthOf::Expected => DepthPlane::Expected,
        TwinDepthOf::Median => DepthPlane::Median,
        TwinDepthOf::Mode => DepthPlane::Mode,
    };
    let uniform = DepthLossUniform {
        weight: loss.weight as f32,
        patch_weight: loss.patch_weight as f32,
        normal_weight: loss.normal_weight as f32,
        kind: kind as u32,
        plane: plane as u32,
        inverse: u32::from(loss.inverse),
        patch_vectors: SIZE.patch_vectors(),
        normals: 1,
    };
    (uniform, kind)
}

/// Draws targets about what is rendered, in the form that is compared; none at fragile pixels.
fn targets(depths: &TwinDepths, loss: &TwinDepthLoss) -> Vec<TwinTarget> {
    let mut random = Random::new(23);
    let pixels = depths.pixels.iter().zip(&depths.fragile);
    let target = |(p, fragile): (&TwinDepth, &bool)| {
        let factor = random.uniform(0.5, 1.5);
        let weight = random.uniform(-0.2, 1.0).max(0.0);
        let normal = [(); 3].map(|()| f32_exact(random.uniform(-1.0, 1.0)));
        let depth = factor * p.sum / p.alpha.max(1e-3);
        let form = if loss.inverse { 1.0 / depth } else { depth };
        if *fragile || (p.alpha - 0.5).abs() <= NEAR_HALF || !form.is_finite() {
            return TwinTarget::default();
        }
        TwinTarget {
            depth: f32_exact(form),
            weight: f32_exact(weight),
            normal,
        }
    };
    pixels.map(target).collect()
}

/// Returns what `planes` has. The losses are held to the reference of these numbers: their derivative is divided by the
/// spread of the depths, so that what rounding has made of the depths themselves would count many times.
fn rendered(rig: &Rig, planes: &[f32]) -> Vec<TwinDepth> {
    let plane = 4 * rig.view.plane_len();
    let of_pixel = |i: usize| {
        let value = |k: usize| f64::from(planes[k * plane + i]);
        TwinDepth {
            sum: value(0),
            normal: [value(1), value(2), value(3)],
            median: value(4),
            mode: value(5),
            alpha: 1.0 - value(TRANSMITTANCE),
        }
    };
    rig.pixels().map(of_pixel).collect()
}

/// Holds the losses of what `planes` has, and their gradients, to the reference; nothing where few pixels
/// show different depths.
///
/// # Errors
/// A GPU fault.
pub(super) fn hold_losses(
    ctx: &Context,
    rig: &Rig,
    depth: &DepthPass,
    planes: &[f32],
    depths: &TwinDepths,
    bounds: Bounds,
    out: &mut Findings,
) -> Result<()> {
    let plane = 4 * rig.view.plane_len();
    // An error's sign is rounding's if all depths are one.
    let covered = depths.pixels.iter().filter(|p| p.alpha > 0.5);
    let covered: Vec<f64> = covered.map(|p| p.sum / p.alpha).collect();
    let nearest = covered.iter().copied().fold(f64::INFINITY, f64::min);
    let farthest = covered.iter().copied().fold(0.0, f64::max);
    if covered.len() < LEAST_COVERED || farthest < (1.0 + LEAST_SPREAD) * nearest {
        return Ok(());
    }
    let width = rig.view.size[0] as usize;
    let rendered = rendered(rig, planes);
    for loss in losses() {
        let target = targets(depths, &loss);
        let mut packed = vec![0.0; SIZE.n_planes() * plane];
        for (i, t) in rig.pixels().zip(&target) {
            let [x, y, z] = t.normal;
            for (k, value) in [t.depth, t.weight, x, y, z].into_iter().enumerate() {
                packed[k * plane + i] = value as f32;
            }
        }
        depth.set_target(&ctx.gpu, &packed);
        depth.buffer("depths").write(&ctx.gpu, planes);
        let (uniform, kind) = uniform_of(&loss);
        depth.set_loss(&ctx.gpu, uniform);
        let mut commands = Commands::new(&ctx.gpu);
        rig.pass(ctx)
            .depth_loss(&mut commands, &ctx.depth, depth, kind);
        commands.submit();
        let what = format!("{:?} of {:?}", loss.kind, loss.of);
        let theirs = depth_losses(&rendered, &target, &loss, width);
        let ours = depth.read_losses(&ctx.gpu)?;
        let bound = tolerance::GPU_DEPTH_LOSS.max(bounds.image);
        for (k, part) in ["image", "patches", "normals", "share"].iter().enumerate() {
            let at = (stage::DEPTH_LOSS, &*format!("{what}, {part}"));
            out.close(at, &ours[k..=k], &theirs[k..=k], bound);
        }
        let theirs = depth_loss_gradient(&rendered, &target, &loss, width);
        let ours: Vec<f32> = depth
            .buffer("depths")
            .read(&ctx.gpu, TRANSMITTANCE * plane)?;
        for (part, columns) in [("depths", vec![0, 4, 5, 6]), ("normals", vec![1, 2, 3])] {
            let (ours, theirs) = (&ours, &theirs);
            let pick = |k: &usize| {
                let first = k * plane;
                rig.pixels().map(move |i| f64::from(ours[first + i]))
            };
            let ours: Vec<f64> = columns.iter().flat_map(pick).collect();
            let pick = |k: &usize| {
                let k = *k;
                theirs.iter().map(move |d| values(d)[k])
            };
            let theirs: Vec<f64> = columns.iter().flat_map(pick).collect();
            let at = (stage::DEPTH_LOSS, &*format!("{what}, gradient of {part}"));
            let bound = tolerance::GPU_DEPTH_LOSS_GRADIENT.max(bounds.image);
            out.close(at, &ours, &theirs, bound);
        }
    }
    Ok(())
}
