//! Rasterization and its gradient, end to end from the stored parameters.

use super::finding::Findings;
use super::rig::{Context, Rig, ViewGradients, wide};
use super::stage;
use crate::doctor::twin::linalg::{normalize, sub};
use crate::doctor::twin::model::{SplatGradient, TwinCamera, TwinGaussians, TwinSplat};
use crate::doctor::twin::{sh, tolerance};
use crate::error::Result;
use crate::gpu::constants::PAIR_BLOCK;
use crate::gpu::{Commands, Rasterizer};
use crate::render::Rendered;

/// The reference's image, its weights in a linear loss, and the gradients of that loss.
pub struct Truth<'a> {
    /// The image, `[height][width][3]`.
    pub rgb: &'a [f64],
    /// `[height][width]`: 1 - final transmittance.
    pub alpha: &'a [f64],
    /// `[height][width]`: whether single precision may decide otherwise at a pixel.
    pub fragile: &'a [bool],
    /// Gradient of the loss with respect to `rgb`.
    pub d_rgb: &'a [f64],
    /// Gradient of the loss with respect to `alpha`.
    pub d_alpha: &'a [f64],
    /// Name and flat gradient of every class of stored parameters.
    pub classes: [(&'static str, Vec<f64>); 5],
}

/// Holds an image off fragile pixels to `bound`, and everywhere to what one decision can change.
pub fn hold_image(
    image: &Rendered,
    rasterizer: Rasterizer,
    truth: &Truth<'_>,
    bound: f64,
    out: &mut Findings,
) {
    let rasterize = stage::own(rasterizer).rasterize;
    let nowhere = vec![false; truth.fragile.len()];
    for (what, ours, theirs) in [
        ("rgb", wide(&image.rgb), truth.rgb),
        ("alpha", wide(&image.alpha), truth.alpha),
    ] {
        out.image((rasterize, what), &ours, theirs, truth.fragile, bound);
        let what = format!("{what} at fragile pixels");
        let fragile_bound = tolerance::GPU_IMAGE_FRAGILE;
        out.image((rasterize, &what), &ours, theirs, &nowhere, fragile_bound);
    }
}

/// Holds the gradient of every class of parameters, relative L2.
pub fn hold_gradients(
    ours: &ViewGradients,
    gaussians: &TwinGaussians,
    camera: &TwinCamera,
    truth: &Truth<'_>,
    bound: f64,
    out: &mut Findings,
) {
    let expanded = expand_sh(&ours.color, gaussians, camera);
    let classes = [
        &ours.means,
        &expanded,
        &ours.opacity_logit,
        &ours.scale_log,
        &ours.rotation_wxyz,
    ];
    for ((class, theirs), ours) in truth.classes.iter().zip(classes) {
        out.close((stage::PROJECT_BACKWARD, class), ours, theirs, bound);
    }
}

/// Returns the SH gradient, which the GPU never stores: a coefficient's basis function times the
/// colour's gradient.
fn expand_sh(color: &[[f64; 3]], gaussians: &TwinGaussians, camera: &TwinCamera) -> Vec<f64> {
    let center = camera.center();
    let n_sh = (gaussians.sh_degree + 1).pow(2);
    let of_gaussian = |(color, mean): (&[f64; 3], &[f64; 3])| {
        let (direction, _) = normalize(&sub(mean, &center));
        let y = sh::basis(direction);
        let color = *color;
        (0..16).flat_map(move |k| color.map(|c| if k < n_sh && c != 0.0 { y[k] * c } else { 0.0 }))
    };
    let pairs = color.iter().zip(&gaussians.means);
    pairs.flat_map(of_gaussian).collect()
}

/// The reference's splats and their gradients.
#[derive(Clone, Copy)]
pub struct TwinSplats<'a> {
    /// Projected Gaussians, in the Gaussians' order.
    pub splats: &'a [TwinSplat],
    /// Gradients to `splats`, in the same order.
    pub gradients: &'a [SplatGradient],
}

/// Carries `truth`'s weights back stage by stage after a forward pass, holds each stage to the
/// reference, and returns the gradients for [`hold_gradients`].
///
/// # Errors
/// A GPU fault.
pub fn examine_backward(
    ctx: &Context,
    rig: &Rig,
    twin: TwinSplats<'_>,
    truth: &Truth<'_>,
    bound: f64,
    out: &mut Findings,
) -> Result<ViewGradients> {
    rig.write_image(ctx, "d_rendered", truth.d_rgb, truth.d_alpha, 0.0);
    let mut commands = Commands::new(&ctx.gpu);
    rig.pass(ctx).rasterize_backward(&mut commands);
    commands.submit();
    let ranges: Vec<[u32; 2]> = rig.read(ctx, "gaussian_pairs", rig.model.n)?;
    let n_pairs = ranges.iter().map(|r| r[1] as usize).max().unwrap_or(0);
    let pairs = read_pairs(ctx, rig, n_pairs.min(rig.workspace.capacity.pairs))?;
    let sums: Vec<SplatGradient> = ranges.iter().map(|range| sum_of(&pairs, range)).collect();
    let expected: Vec<SplatGradient> = twin
        .splats
        .iter()
        .zip(twin.gradients)
        .map(|(splat, d)| moments_of(splat, d))
        .collect();
    for (what, columns) in [
        ("exponent", 0..1),
        ("first moments", 1..3),
        ("second moments", 3..6),
        ("colour", 6..9),
    ] {
        let pick = |rows: &[SplatGradient]| -> Vec<f64> {
            let of_row = |row: &SplatGradient| row[columns.clone()].to_vec();
            rows.iter().flat_map(of_row).collect()
        };
        let at = (stage::own(ctx.kernels.rasterizer).rasterize_backward, what);
        out.close(at, &pick(&sums), &pick(&expected), bound);
    }

    let mut commands = Commands::new(&ctx.gpu);
    rig.pass(ctx).sum_pairs(&mut commands);
    commands.submit();
    let summed = read_pairs(ctx, rig, pairs.len())?;
    let n_wrong = n_wrong_sums(&pairs, &summed, &ranges);
    out.none((stage::SUM_PAIRS, "sums"), n_wrong);
    let moments: Vec<[f64; 5]> = read_moments(ctx, rig, &ranges)?;
    let at = (stage::SUM_PAIRS, "moments of Gaussians");
    let expected: Vec<f64> = sums.iter().flat_map(|sum| sum[1..6].to_vec()).collect();
    out.close(at, moments.as_flattened(), &expected, bound);
    let mut commands = Commands::new(&ctx.gpu);
    rig.pass(ctx).project_backward(&mut commands);
    commands.submit();
    hold_screen(ctx, rig, &ranges, twin, bound, out)?;
    rig.gradients(ctx)
}

/// Reads each pair's sums: `v, v t_x, v t_y, v t_x^2, v t_x t_y, v t_y^2, d_rgb`.
pub(super) fn read_pairs(ctx: &Context, rig: &Rig, n_pairs: usize) -> Result<Vec<[f32; 9]>> {
    let a: Vec<[f32; 4]> = rig.read(ctx, "d_pair_a", n_pairs)?;
    let b: Vec<[f32; 4]> = rig.read(ctx, "d_pair_b", n_pairs)?;
    let c: Vec<f32> = rig.read(ctx, "d_pair_c", n_pairs)?;
    let pairs = a.iter().zip(&b).zip(&c);
    let join = |((a, b), c): ((&[f32; 4], &[f32; 4]), &f32)| {
        [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], *c]
    };
    Ok(pairs.map(join).collect())
}

/// Returns each Gaussian's sums of `v t_x, v t_y, v t_x^2, v t_x t_y, v t_y^2`, which have taken its splat's
/// place; 0 where it has no pair.
fn read_moments(ctx: &Context, rig: &Rig, ranges: &[[u32; 2]]) -> Result<Vec<[f64; 5]>> {
    let splats: Vec<[f32; 12]> = rig.read(ctx, "splats", rig.model.n)?;
    let moments = |(splat, range): (&[f32; 12], &[u32; 2])| {
        let numbers = [splat[0], splat[1], splat[2], splat[3], splat[7]];
        match range[0] == range[1] {
            // Marked by a factor of 0.
            true => [f64::from(splat[4]); 5],
            false => numbers.map(f64::from),
        }
    };
    Ok(splats.iter().zip(ranges).map(moments).collect())
}

/// Returns the sum over a range of pairs.
pub(super) fn sum_of(pairs: &[[f32; 9]], [first, end]: &[u32; 2]) -> SplatGradient {
    let end = (*end as usize).min(pairs.len());
    let mut sum = [0.0; 9];
    for pair in &pairs[(*first as usize).min(end)..end] {
        sum.iter_mut()
            .zip(pair)
            .for_each(|(s, x)| *s += f64::from(*x));
    }
    sum
}

/// Counts entries of `summed` that are not what `pairs` add up to: the first pair of an aligned
/// block that is one Gaussian's holds the block's sum, that of a block of such blocks theirs.
fn n_wrong_sums(pairs: &[[f32; 9]], summed: &[[f32; 9]], ranges: &[[u32; 2]]) -> usize {
    let mut n_summed = vec![1; pairs.len()];
    for [first, end] in ranges {
        for size in [PAIR_BLOCK, PAIR_BLOCK * PAIR_BLOCK] {
            let mut block = first.next_multiple_of(size);
            while block + size <= *end && (block + size) as usize <= pairs.len() {
                n_summed[block as usize] = size;
                block += size;
            }
        }
    }
    let is_wrong = |i: &usize| {
        let block = &pairs[*i..*i + n_summed[*i] as usize];
        (0..9).any(|c| {
            let (mut sum, mut size) = (0.0, 0.0);
            for pair in block {
                sum += f64::from(pair[c]);
                size += f64::from(pair[c]).abs();
            }
            // A NaN is wrong, too.
            let error = (f64::from(summed[*i][c]) - sum).abs();
            error.is_nan() || error > tolerance::GPU_PAIR_SUM * size
        })
    };
    (0..pairs.len()).filter(is_wrong).count()
}

/// Returns the reference's gradient to a splat in the terms of [`read_pairs`]: `v` is the gradient
/// of the exponent and `t = (l_xx dx + l_xy dy, l_yy dy)` with `|t|^2 ln 2 = q / 2`.
pub(super) fn moments_of(splat: &TwinSplat, d: &SplatGradient) -> SplatGradient {
    if !splat.valid {
        return [0.0; 9];
    }
    let [du, dv, d_a, d_b, d_c, r, g, b, d_opacity] = *d;
    let [conic_a, conic_b, _] = splat.conic;
    let [xx, xy, yy] = splat.cov2d;
    let two_ln_2 = 2.0 * std::f64::consts::LN_2;
    let l_xx = (conic_a / two_ln_2).sqrt();
    let l_xy = conic_b / (two_ln_2 * l_xx);
    let l_yy = 1.0 / (two_ln_2 * yy).sqrt();
    // Sums of v dx, v dy: d(u, v) = conic (sum v dx, sum v dy).
    let (x, y) = (xx * du + xy * dv, xy * du + yy * dv);
    let (s_xx, s_xy, s_yy) = (-2.0 * d_a, -d_b, -2.0 * d_c);
    [
        splat.opacity * d_opacity,
        l_xx * x + l_xy * y,
        l_yy * y,
        l_xx * l_xx * s_xx + 2.0 * l_xx * l_xy * s_xy + l_xy * l_xy * s_yy,
        l_yy * (l_xx * s_xy + l_xy * s_yy),
        l_yy * l_yy * s_yy,
        r,
        g,
        b,
    ]
}

/// Holds what densification looks at: the gradient of the mean on screen and the radius there.
fn hold_screen(
    ctx: &Context,
    rig: &Rig,
    ranges: &[[u32; 2]],
    twin: TwinSplats<'_>,
    bound: f64,
    out: &mut Findings,
) -> Result<()> {
    let screen: Vec<[f32; 2]> = rig.read(ctx, "screen", rig.model.n)?;
    let [width, height] = [rig.view.size[0], rig.view.size[1]].map(f64::from);
    let expected = ranges.iter().zip(twin.splats.iter().zip(twin.gradients));
    let expected: Vec<[f64; 2]> = expected
        .map(|(range, (splat, d))| {
            if range[0] == range[1] {
                return [0.0; 2];
            }
            let gradient = (0.5 * width * d[0]).hypot(0.5 * height * d[1]);
            let [xx, xy, yy] = splat.cov2d;
            let largest = 0.5 * (xx + yy + (xx - yy).hypot(2.0 * xy));
            [gradient, 3.0 * largest.sqrt() / width.max(height)]
        })
        .collect();
    for (column, what) in ["screen gradient", "screen radius"].into_iter().enumerate() {
        let ours: Vec<f64> = screen.iter().map(|s| f64::from(s[column])).collect();
        let theirs: Vec<f64> = expected.iter().map(|s| s[column]).collect();
        out.close((stage::PROJECT_BACKWARD, what), &ours, &theirs, bound);
    }
    Ok(())
}
