//! Depths and normals: what is rendered, its losses, and the gradients, behind those of the colours.

use super::bounds::Bounds;
use super::depth_losses::{N_VALUES, SIZE, TRANSMITTANCE, hold_losses, values};
use super::finding::Findings;
use super::image::{moments_of, read_pairs, sum_of};
use super::rig::{Context, POISON, Rig};
use super::stage;
use crate::doctor::twin::depth::{
    TwinDepth, TwinDepthGradients, TwinDepths, depth_weights, depths_backward, render_depths,
    splat_depths,
};
use crate::doctor::twin::model::{SplatGradient, TwinCamera, TwinGaussians, TwinGradients};
use crate::doctor::twin::raster::TwinRender;
use crate::doctor::twin::tolerance;
use crate::error::Result;
use crate::gpu::Commands;
use crate::render::{DepthPass, Pass, PoseGradient};

/// What the reference has of the colours: image, gradients and that of the pose.
pub struct Twin<'a> {
    /// The image.
    pub render: &'a TwinRender,
    /// Gradients of the colours' loss.
    pub gradients: &'a TwinGradients,
    /// Gradient of that loss with respect to the camera's motion.
    pub pose: [f64; 6],
}

/// Renders a view, its depths and normals, and carries both gradients back; each stage is held to the
/// reference. The pairs must fit.
///
/// # Errors
/// A GPU fault.
pub fn examine(
    ctx: &Context,
    rig: &Rig,
    (gaussians, camera): (&TwinGaussians, &TwinCamera),
    twin: &Twin<'_>,
    (d_rgb, d_alpha): (&[f64], &[f64]),
    bounds: Bounds,
    out: &mut Findings,
) -> Result<()> {
    let (gpu, kernels) = (&ctx.gpu, &ctx.depth);
    let own = stage::own(ctx.kernels.rasterizer);
    let depth = DepthPass::new(gpu, kernels, &rig.workspace, &rig.model, &[rig.view], SIZE)?;
    for name in [
        "splat_depths",
        "depths",
        "d_pair_depth",
        "depth_sums",
        "depth_losses",
    ] {
        let buffer = depth.buffer(name);
        buffer.write(gpu, &vec![POISON; buffer.bytes() as usize / 4]);
    }
    rig.start(ctx);
    let pass = rig.pass(ctx);
    let run = |record: &dyn Fn(&Pass<'_>, &mut Commands<'_>)| {
        let mut commands = Commands::new(gpu);
        record(&pass, &mut commands);
        commands.submit();
    };
    run(&|pass, commands| {
        pass.forward(commands);
        pass.project_depth(commands, kernels, &depth);
    });
    let depths = render_depths(gaussians, camera, twin.render, tolerance::FRAGILE);
    hold_gaussians(ctx, &depth, (gaussians, camera), twin.render, bounds, out)?;
    run(&|pass, commands| pass.rasterize_depth(commands, kernels, &depth));
    let planes: Vec<f32> = depth
        .buffer("depths")
        .read(gpu, 11 * 4 * rig.view.plane_len())?;
    hold_image(rig, own.rasterize_depth, &planes, &depths, bounds, out);
    hold_losses(ctx, rig, &depth, &planes, &depths, bounds, out)?;

    let d = depth_weights(&depths, 19);
    let gradients = depths_backward(gaussians, camera, twin.render, &d);
    write_gradient(rig, ctx, &depth, &planes, &d);
    rig.write_image(ctx, "d_rendered", d_rgb, d_alpha, 0.0);
    run(&|pass, commands| {
        pass.rasterize_backward(commands);
        pass.rasterize_depth_backward(commands, kernels, &depth);
    });
    hold_pairs(ctx, rig, &depth, twin, &gradients, bounds, out)?;
    let pose = PoseGradient::new(gpu, &ctx.pose, &rig.workspace, &rig.model)?;
    run(&|pass, commands| {
        pass.sum_pairs(commands);
        pass.project_backward(commands);
        pass.project_depth_backward(commands, kernels, &depth);
        pass.pose_backward(commands, &ctx.pose, &pose);
    });
    hold_parameters(ctx, rig, twin, &gradients, bounds, out)?;
    let moved = gradients.raw.iter().map(|raw| raw.pose);
    let moved = moved.fold(twin.pose, |sum, part| {
        std::array::from_fn(|k| sum[k] + part[k])
    });
    let at = (stage::PROJECT_DEPTH_BACKWARD, "pose");
    // It is the sum of two parts, the colours' and the depths', each within the bound.
    out.close(at, &pose.read(gpu)?, &moved, 2.0 * bounds.gradient);
    Ok(())
}

/// Holds depths and normals of the Gaussians that the reference draws.
fn hold_gaussians(
    ctx: &Context,
    depth: &DepthPass,
    (gaussians, camera): (&TwinGaussians, &TwinCamera),
    render: &TwinRender,
    bounds: Bounds,
    out: &mut Findings,
) -> Result<()> {
    let ours: Vec<[f32; 4]> = depth.buffer("splat_depths").read(&ctx.gpu, gaussians.n())?;
    let theirs = splat_depths(gaussians, camera);
    let drawn: Vec<usize> = (0..gaussians.n())
        .filter(|&i| render.projected[i].valid && theirs[i].1 > tolerance::FRAGILE)
        .collect();
    let pick = |columns: std::ops::Range<usize>| -> [Vec<f64>; 2] {
        let ours = drawn
            .iter()
            .flat_map(|&i| ours[i][columns.clone()].to_vec());
        let theirs = drawn
            .iter()
            .flat_map(|&i| theirs[i].0[columns.clone()].to_vec());
        [ours.map(f64::from).collect(), theirs.collect()]
    };
    for (what, columns) in [("normals", 0..3), ("depths", 3..4)] {
        let [ours, theirs] = pick(columns);
        out.close(
            (stage::PROJECT_DEPTH, what),
            &ours,
            &theirs,
            bounds.projection,
        );
    }
    Ok(())
}

/// Holds what is rendered, each number as a share of the largest of its kind.
fn hold_image(
    rig: &Rig,
    stage: &'static str,
    planes: &[f32],
    depths: &TwinDepths,
    bounds: Bounds,
    out: &mut Findings,
) {
    let theirs: Vec<[f64; N_VALUES]> = depths.pixels.iter().map(values).collect();
    let plane = 4 * rig.view.plane_len();
    for (k, what) in [
        (0, "sum of depths"),
        (1, "normals, x"),
        (2, "normals, y"),
        (3, "normals, z"),
        (4, "median"),
        (5, "mode"),
        (TRANSMITTANCE, "transmittance"),
    ] {
        let theirs: Vec<f64> = theirs.iter().map(|values| values[k]).collect();
        let most = theirs.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        let scale = if most > 0.0 { 1.0 / most } else { 1.0 };
        let scaled = |values: Vec<f64>| -> Vec<f64> { values.iter().map(|x| scale * x).collect() };
        let ours: Vec<f64> = rig
            .pixels()
            .map(|i| f64::from(planes[k * plane + i]))
            .collect();
        let (ours, theirs) = (scaled(ours), scaled(theirs));
        out.image((stage, what), &ours, &theirs, &depths.fragile, bounds.image);
    }
}

/// Puts a gradient in place of what was rendered, which `planes` holds; the rest is as it was.
fn write_gradient(rig: &Rig, ctx: &Context, depth: &DepthPass, planes: &[f32], d: &[TwinDepth]) {
    let mut planes = planes.to_vec();
    let plane = 4 * rig.view.plane_len();
    planes[..TRANSMITTANCE * plane].fill(0.0);
    for (i, d) in rig.pixels().zip(d) {
        for (k, value) in values(d)[..TRANSMITTANCE].iter().enumerate() {
            planes[k * plane + i] = *value as f32;
        }
    }
    depth.buffer("depths").write(&ctx.gpu, &planes);
}

/// Holds the sums over each Gaussian's pairs, those of the colours among them.
fn hold_pairs(
    ctx: &Context,
    rig: &Rig,
    depth: &DepthPass,
    twin: &Twin<'_>,
    gradients: &TwinDepthGradients,
    bounds: Bounds,
    out: &mut Findings,
) -> Result<()> {
    let stage = stage::own(ctx.kernels.rasterizer).rasterize_depth_backward;
    let ranges: Vec<[u32; 2]> = rig.read(ctx, "gaussian_pairs", rig.model.n)?;
    let n_pairs = ranges.iter().map(|r| r[1] as usize).max().unwrap_or(0);
    let n_pairs = n_pairs.min(rig.workspace.capacity.pairs);
    let pairs = read_pairs(ctx, rig, n_pairs)?;
    let sums: Vec<SplatGradient> = ranges.iter().map(|range| sum_of(&pairs, range)).collect();
    let both = twin.gradients.splats.iter().zip(&gradients.splats);
    let both = both.map(|(a, b)| -> SplatGradient { std::array::from_fn(|k| a[k] + b[k]) });
    let expected = twin.render.projected.iter().zip(both);
    let expected: Vec<SplatGradient> = expected.map(|(s, d)| moments_of(s, &d)).collect();
    for (what, columns) in [
        ("exponent", 0..1),
        ("first moments", 1..3),
        ("second moments", 3..6),
    ] {
        let pick = |rows: &[SplatGradient]| -> Vec<f64> {
            rows.iter()
                .flat_map(|row| row[columns.clone()].to_vec())
                .collect()
        };
        out.close(
            (stage, what),
            &pick(&sums),
            &pick(&expected),
            bounds.gradient,
        );
    }
    let pairs: Vec<[f32; 4]> = depth.buffer("d_pair_depth").read(&ctx.gpu, n_pairs)?;
    let sum = |[first, end]: &[u32; 2]| {
        let end = (*end as usize).min(n_pairs);
        let own = pairs[(*first as usize).min(end)..end].iter();
        own.fold([0.0; 4], |sum, pair| -> [f64; 4] {
            std::array::from_fn(|k| sum[k] + f64::from(pair[k]))
        })
    };
    let sums: Vec<[f64; 4]> = ranges.iter().map(sum).collect();
    for (what, columns) in [("normals", 0..3), ("depths", 3..4)] {
        let pick = |rows: &[[f64; 4]]| -> Vec<f64> {
            rows.iter()
                .flat_map(|row| row[columns.clone()].to_vec())
                .collect()
        };
        let (ours, theirs) = (pick(&sums), pick(&gradients.depths));
        out.close((stage, what), &ours, &theirs, bounds.gradient);
    }
    Ok(())
}

/// Holds the gradients of the stored parameters, those of the colours' loss among them.
fn hold_parameters(
    ctx: &Context,
    rig: &Rig,
    twin: &Twin<'_>,
    gradients: &TwinDepthGradients,
    bounds: Bounds,
    out: &mut Findings,
) -> Result<()> {
    let ours = rig.gradients(ctx)?;
    let colors = twin.gradients;
    let raw = &gradients.raw;
    let sum =
        |a: &[f64], b: Vec<f64>| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a + b).collect() };
    let means = raw.iter().flat_map(|raw| raw.mean).collect();
    let logits = raw.iter().map(|raw| raw.opacity_logit).collect();
    let scales = raw.iter().flat_map(|raw| raw.scale_log).collect();
    let rotations = raw.iter().flat_map(|raw| raw.rotation_wxyz).collect();
    for (what, ours, theirs) in [
        ("means", ours.means, sum(colors.means.as_flattened(), means)),
        (
            "opacity_logit",
            ours.opacity_logit,
            sum(&colors.opacity_logit, logits),
        ),
        (
            "scale_log",
            ours.scale_log,
            sum(colors.scale_log.as_flattened(), scales),
        ),
        (
            "rotation_wxyz",
            ours.rotation_wxyz,
            sum(colors.rotation_wxyz.as_flattened(), rotations),
        ),
    ] {
        let at = (stage::PROJECT_DEPTH_BACKWARD, what);
        out.close(at, &ours, &theirs, bounds.gradient);
    }
    Ok(())
}
