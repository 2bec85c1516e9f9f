//! The image losses and their gradient.

use glam::{DMat3, DVec3, Vec3};

use super::finding::Findings;
use super::rig::{Context, Rig, wide};
use super::stage;
use crate::camera::Camera;
use crate::doctor::twin::loss::loss;
use crate::doctor::twin::random::Random;
use crate::doctor::twin::tolerance;
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::gpu::constants::{LOSS_ROWS, LOSS_STRIP};
use crate::render::{LossUniform, ViewUniform};

/// Share of SSIM in the loss.
pub const SSIM_WEIGHT: f64 = 0.2;

/// The size of a photograph as it is trained on.
pub const LARGE: (usize, usize) = (1600, 1067);

/// An image whose parts that workgroups own have seams across and down, and several each way.
pub const SEAMS: (usize, usize) = (2 * LOSS_STRIP as usize + 13, 2 * LOSS_ROWS as usize + 11);

/// Content of the two images.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// Random values; the render's go beyond `[0, 1]`.
    Noise,
    /// Flat but for the last bits of 8: SSIM's variances nearly vanish.
    Flat,
    /// As flat, and far off everywhere: the residual all but cancels in the gradient.
    Off,
    /// The render is exactly the target image.
    Equal,
    /// All values are 0.
    Black,
}

/// The weights of pixels.
#[derive(Clone, Copy, Debug)]
pub enum MaskKind {
    /// A random half of the pixels.
    Half,
    /// A single pixel near the middle.
    OnePixel,
    /// All pixels but those of a rectangle.
    Hole,
    /// The hole at a weight below 1.
    Filled,
    /// Every weight at random.
    Any,
    /// Every pixel, at weight 1.
    Full,
    /// No pixel: the losses are of nothing.
    Empty,
}

impl MaskKind {
    /// Every kind of mask.
    pub const ALL: [MaskKind; 7] = [
        MaskKind::Half,
        MaskKind::OnePixel,
        MaskKind::Hole,
        MaskKind::Filled,
        MaskKind::Any,
        MaskKind::Full,
        MaskKind::Empty,
    ];

    fn name(self) -> &'static str {
        match self {
            MaskKind::Half => "half",
            MaskKind::OnePixel => "one pixel",
            MaskKind::Hole => "hole",
            MaskKind::Filled => "filled",
            MaskKind::Any => "any",
            MaskKind::Full => "full",
            MaskKind::Empty => "empty",
        }
    }

    /// Returns the weights in 255ths, `height * width`.
    fn of(self, width: usize, height: usize) -> Vec<u8> {
        let n = width * height;
        let mut random = Random::new(n as u64);
        let weight = |pixel: usize| {
            let (x, y) = (pixel % width, pixel / width);
            let in_hole = x > width / 4 && y > height / 4 && x < width / 2;
            match self {
                MaskKind::Half => 255 * u8::from(random.uniform(0.0, 1.0) < 0.5),
                MaskKind::OnePixel => 255 * u8::from(pixel == n / 2),
                MaskKind::Hole => 255 * u8::from(!in_hole),
                MaskKind::Filled => {
                    if in_hole {
                        77
                    } else {
                        255
                    }
                }
                MaskKind::Any => random.uniform(0.0, 256.0) as u8,
                MaskKind::Full => 255,
                MaskKind::Empty => 0,
            }
        };
        (0..n).map(weight).collect()
    }
}

/// A render and the target image that it is compared with.
pub struct LossCase {
    /// Width and height, pixels.
    pub size: (usize, usize),
    /// Content of both images.
    pub kind: Kind,
    /// Weights of the pixels; `None`: the loss has no mask.
    pub mask: Option<MaskKind>,
}

/// Returns `height * width * 3` bytes of the target image and values of the render.
pub(super) fn images(kind: Kind, (width, height): (usize, usize)) -> (Vec<u8>, Vec<f64>) {
    let mut random = Random::new(width as u64 * 1000 + height as u64);
    let mut value = |i: usize| match kind {
        Kind::Noise => (random.uniform(0.0, 256.0), random.uniform(-0.2, 1.2)),
        Kind::Flat => (
            200.0 + random.uniform(0.0, 2.0),
            0.79 + 1e-3 * random.uniform(-1.0, 1.0),
        ),
        Kind::Off => (
            100.0 + random.uniform(0.0, 2.0),
            0.84 + 1e-3 * random.uniform(-1.0, 1.0),
        ),
        Kind::Equal => {
            let byte = (i % 256) as f64;
            (byte, byte / 255.0)
        }
        Kind::Black => (0.0, 0.0),
    };
    let of_value = |i: usize| {
        let (byte, render) = value(i);
        (byte as u8, f64::from(render as f32))
    };
    (0..3 * width * height).map(of_value).unzip()
}

/// Makes a rig for images of this size; what it would render does not matter.
///
/// # Errors
/// A case that the adapter cannot hold.
pub fn rig(ctx: &Context, (width, height): (usize, usize)) -> Result<Rig> {
    let camera = Camera {
        name: "any".into(),
        width: width as u32,
        height: height as u32,
        fx: 10.0,
        fy: 10.0,
        cx: 0.5 * width as f64,
        cy: 0.5 * height as f64,
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    let gaussians = Gaussians {
        means: vec![Vec3::Z],
        scales_log: vec![Vec3::splat(-3.0)],
        rotations_wxyz: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.0],
        sh: vec![0.0; 3],
        sh_degree: 0,
    };
    Rig::new(
        ctx,
        &gaussians,
        ViewUniform::new(&camera, 0.01, [0.0; 3]),
        0,
    )
}

/// Holds the losses and their gradient of one pair of images to the reference; what lies in the
/// padding must not matter, nor get a gradient.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn examine(ctx: &Context, case: &LossCase) -> Result<Findings> {
    let LossCase { size, kind, mask } = *case;
    let (width, height) = size;
    let n = width * height;
    let own = stage::own(ctx.kernels.rasterizer);
    let (stage, mask_name) = match mask {
        Some(mask) => (own.masked_loss, format!(", {} mask", mask.name())),
        None => (own.loss, String::new()),
    };
    let kind_name = format!("{kind:?}").to_lowercase();
    let mut out = Findings::of(format!("{kind_name}{mask_name} {width}x{height}"));
    let (goal, render) = images(kind, size);
    let alpha = mask.map_or(vec![255; n], |mask| mask.of(width, height));
    let weights: Vec<f64> = alpha.iter().map(|a| f64::from(*a) / 255.0).collect();
    let n_valid = alpha.iter().filter(|a| **a > 0).count();
    let total: f64 = weights.iter().sum();

    let rig = rig(ctx, size)?;
    rig.poison(ctx);
    rig.write_image(ctx, "rendered", &render, &vec![0.5; n], 7.0);
    let uniform = LossUniform::new(1.0, SSIM_WEIGHT, total, mask.is_some());
    let [l1, ssim] = rig.loss(ctx, uniform, &texels(&goal, &alpha))?;
    let ours = rig.read_rgb(ctx, "d_rendered")?;
    let padded = wide(&rig.read::<f32>(ctx, "d_rendered", 16 * rig.view.plane_len())?);
    let n_not_zero = |v: &[f64]| v.iter().filter(|x| **x != 0.0).count();
    let n_in_padding = n_not_zero(&padded).abs_diff(n_not_zero(&ours));
    out.none(
        (stage, "gradients in the padding and of coverage"),
        n_in_padding,
    );
    if n_valid == 0 {
        out.equal((stage, "losses of nothing"), &[l1, ssim], &[0.0, 0.0]);
        out.none((stage, "gradients of nothing"), n_not_zero(&ours));
        return Ok(out);
    }

    let target: Vec<f64> = goal.iter().map(|b| f64::from(*b) / 255.0).collect();
    let twin = loss(
        &render,
        &target,
        mask.map(|_| weights.as_slice()),
        width,
        height,
        SSIM_WEIGHT,
    );
    let bound = tolerance::GPU_LOSS;
    out.add((stage, "L1"), (l1 - twin.l1).abs(), bound);
    out.add((stage, "SSIM"), (ssim - twin.ssim).abs(), bound);
    match kind {
        // The gradient is 0 or hangs on the sign of rounding: bounded is all it can be.
        Kind::Equal | Kind::Black => {
            let largest = ours.iter().fold(0.0f64, |m, d| m.max(d.abs()));
            let what = (stage, "largest gradient, in pixels");
            out.add(what, largest * total, 1.0);
        }
        _ => out.close((stage, "gradient"), &ours, &twin.d_render, bound),
    }
    Ok(out)
}

/// Colour of the target image and residual of [`examine_residual`], red, green and blue.
const FLAT_GOAL: [u8; 3] = [40, 128, 200];
const RESIDUAL: f64 = 0.45;

/// Holds the losses and their gradient of a flat image of any size of at least 21 pixels a side,
/// all of it off by the same.
///
/// A pixel's gradient hangs on its distance from the edges up to ten pixels alone, so the reference
/// is that of 21x21; sums over the image are linear in either of its sides.
///
/// # Errors
/// A GPU fault, or an image that the adapter cannot hold.
pub fn examine_residual(ctx: &Context, (width, height): (usize, usize)) -> Result<Findings> {
    let mut out = Findings::of(format!("constant residual {width}x{height}"));
    let value = |c: usize| f64::from((f64::from(FLAT_GOAL[c]) / 255.0 + RESIDUAL) as f32);
    let render = |n: usize| -> Vec<f64> { (0..3 * n).map(|i| value(i % 3)).collect() };
    let goal = |n: usize| FLAT_GOAL.repeat(n);
    let n = width * height;
    let rig = rig(ctx, (width, height))?;
    rig.poison(ctx);
    rig.write_image(ctx, "rendered", &render(n), &vec![0.5; n], 7.0);
    let uniform = LossUniform::new(1.0, SSIM_WEIGHT, n as f64, false);
    let [l1, ssim] = rig.loss(ctx, uniform, &texels(&goal(n), &vec![255; n]))?;
    let ours = rig.read_rgb(ctx, "d_rendered")?;

    const SIDE: usize = 21;
    let twin = |width: usize, height: usize| {
        let n = width * height;
        let target: Vec<f64> = goal(n).iter().map(|b| f64::from(*b) / 255.0).collect();
        loss(&render(n), &target, None, width, height, SSIM_WEIGHT)
    };
    let sum = |w: usize, h: usize| twin(w, h).ssim * (w * h) as f64;
    let small = twin(SIDE, SIDE);
    let corner = small.ssim * (SIDE * SIDE) as f64;
    let (wider, higher) = (sum(SIDE + 1, SIDE), sum(SIDE, SIDE + 1));
    let both = sum(SIDE + 1, SIDE + 1);
    let [across, down] = [width, height].map(|side| (side - SIDE) as f64);
    let all = corner
        + across * (wider - corner)
        + down * (higher - corner)
        + across * down * (both - wider - higher + corner);
    let bound = tolerance::GPU_LOSS;
    let stage = stage::own(ctx.kernels.rasterizer).loss;
    out.add((stage, "L1"), (l1 - small.l1).abs(), bound);
    let ssim_error = (ssim - all / n as f64).abs();
    out.add((stage, "SSIM"), ssim_error, bound);
    let near = |at: usize, side: usize| at.min(SIDE / 2).max((at + SIDE).saturating_sub(side));
    let of_pixel = |pixel: usize| {
        let (x, y) = (near(pixel % width, width), near(pixel / width, height));
        let share = (SIDE * SIDE) as f64 / n as f64;
        [0, 1, 2].map(|c| small.d_render[3 * (y * SIDE + x) + c] * share)
    };
    let theirs: Vec<f64> = (0..n).flat_map(of_pixel).collect();
    out.close((stage, "gradient"), &ours, &theirs, bound);
    Ok(out)
}

/// Returns the RGBA8 of a target image.
pub(super) fn texels(goal: &[u8], alpha: &[u8]) -> Vec<u32> {
    let pixels = goal.chunks_exact(3).zip(alpha);
    pixels
        .map(|(p, alpha)| u32::from_le_bytes([p[0], p[1], p[2], *alpha]))
        .collect()
}
