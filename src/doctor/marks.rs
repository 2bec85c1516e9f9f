//! The losses that look at marked pixels of a photograph: the far ones, and the silhouette of its subject.

use super::finding::Findings;
use super::loss::{Kind, SSIM_WEIGHT, images, rig, texels};
use super::rig::Context;
use super::stage;
use crate::doctor::twin::loss::{far_l1, loss, silhouette};
use crate::doctor::twin::random::Random;
use crate::doctor::twin::tolerance;
use crate::error::Result;
use crate::gpu::constants::{FAR_ALPHA, LEVEL_MAX};
use crate::render::LossUniform;

const FAR_WEIGHT: f64 = 0.7;
const SILHOUETTE_WEIGHT: f64 = 0.3;

/// Holds the gradient of all image losses together to the reference, with a third of the pixels far and another beside
/// the subject, which under a mask counts for nothing else.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn examine(ctx: &Context, size: (usize, usize), masked: bool) -> Result<Findings> {
    let n = size.0 * size.1;
    let own = stage::own(ctx.kernels.rasterizer);
    let stage = if masked { own.masked_loss } else { own.loss };
    let mut out = Findings::of(format!("marked pixels {}x{}", size.0, size.1));
    let (goal, render) = images(Kind::Noise, size);
    let mut random = Random::new(n as u64);
    let marks = [u8::MAX, FAR_ALPHA as u8, 0];
    let alpha: Vec<u8> = (0..n)
        .map(|_| marks[random.uniform(0.0, 3.0) as usize])
        .collect();
    // From that of a pixel that is all but covered to that of the faintest.
    let transmittance: Vec<f64> = (0..n)
        .map(|_| f64::from(random.uniform(1e-3, 0.995) as f32))
        .collect();
    let weights: Vec<f64> = alpha.iter().map(|a| f64::from(*a) / LEVEL_MAX).collect();
    let total = if masked {
        weights.iter().sum()
    } else {
        n as f64
    };
    let far: Vec<bool> = alpha.iter().map(|a| u32::from(*a) == FAR_ALPHA).collect();
    let n_far = far.iter().filter(|far| **far).count();

    let rig = rig(ctx, size)?;
    rig.poison(ctx);
    rig.write_image(ctx, "rendered", &render, &transmittance, 7.0);
    let uniform = LossUniform::new(1.0, SSIM_WEIGHT, total, masked)
        .with_far(FAR_WEIGHT, n_far)
        .with_silhouette(SILHOUETTE_WEIGHT, n);
    let [l1, ssim] = rig.loss(ctx, uniform, &texels(&goal, &alpha))?;
    let target: Vec<f64> = goal.iter().map(|b| f64::from(*b) / LEVEL_MAX).collect();
    let mask = masked.then_some(weights.as_slice());
    let twin = loss(&render, &target, mask, size.0, size.1, SSIM_WEIGHT);
    let bound = tolerance::GPU_LOSS;
    out.add((stage, "L1"), (l1 - twin.l1).abs(), bound);
    out.add((stage, "SSIM"), (ssim - twin.ssim).abs(), bound);
    let (_, d_far) = far_l1(&render, &target, &far);
    let gradient = twin.d_render.iter().zip(&d_far);
    let gradient: Vec<f64> = gradient.map(|(d, far)| d + FAR_WEIGHT * far).collect();
    let ours = rig.read_rgb(ctx, "d_rendered")?;
    out.close((stage, "gradient with far pixels"), &ours, &gradient, bound);

    let opacity: Vec<f64> = transmittance.iter().map(|t| 1.0 - t).collect();
    let subject: Vec<bool> = alpha.iter().map(|a| *a > 0).collect();
    let (_, d_opacity) = silhouette(&opacity, &subject);
    let theirs: Vec<f64> = d_opacity.iter().map(|d| SILHOUETTE_WEIGHT * d).collect();
    let ours = rig.read_plane(ctx, "d_rendered", 3)?;
    out.close((stage, "gradient of the silhouette"), &ours, &theirs, bound);
    Ok(out)
}
