//! Whole views: the cases that every stage of a view is held to.

pub use super::bounds::Bounds;
use super::depth;
use super::finding::Findings;
use super::forward::{self, ListLengths};
use super::image::{self, Truth, TwinSplats};
use super::pose;
use super::rig::{Context, Rig};
use crate::doctor::twin::cases::{
    TwinCase, beside, cover, crowd, distant_needles, huge, layers, loss_weights, narrow, needles,
    random_scene,
};
use crate::doctor::twin::dropout::{TwinDropout, TwinGuide};
use crate::doctor::twin::model::{TwinCamera, TwinGaussians};
use crate::doctor::twin::pose::pose_gradient;
use crate::doctor::twin::raster::{TwinRender, backward, render};
use crate::doctor::twin::tolerance;
use crate::error::Result;
use crate::gpu::Commands;

/// Bounds of ordinary Gaussians.
pub const ORDINARY: Bounds = Bounds {
    projection: tolerance::GPU_PROJECTION,
    image: tolerance::GPU_IMAGE,
    gradient: tolerance::GPU_GRADIENT,
};

/// Bounds of Gaussians that cover the screen.
pub const COVERS: Bounds = Bounds {
    gradient: tolerance::GPU_COVER_GRADIENT,
    ..ORDINARY
};

/// Bounds of needles.
pub const NEEDLES: Bounds = Bounds {
    projection: tolerance::GPU_PROJECTION,
    image: tolerance::GPU_NEEDLE_IMAGE,
    gradient: tolerance::GPU_NEEDLE_GRADIENT,
};

/// Gaussians that one camera looks at.
pub struct ViewCase {
    /// Kind of case and size of its image, as findings name it.
    pub name: String,
    /// The reference's Gaussians.
    pub gaussians: TwinGaussians,
    /// The reference's camera.
    pub camera: TwinCamera,
    /// Largest errors that pass.
    pub bounds: Bounds,
    /// Gradient that is carried back.
    pub residual: Residual,
}

/// The gradient of the loss with respect to the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Residual {
    /// Another at every pixel.
    Random,
    /// One for all pixels: nothing cancels, and a sum over many of them has to be as good as one
    /// over few.
    Constant,
}

impl Residual {
    /// Returns the weights `(d_rgb, d_alpha)`, 0 at fragile pixels.
    pub fn weights(self, render: &TwinRender) -> (Vec<f64>, Vec<f64>) {
        if self == Residual::Random {
            return loss_weights(render, 17);
        }
        let weights = |fragile: &bool| {
            if *fragile {
                [0.0; 4]
            } else {
                [0.5, -0.75, 1.0, 0.25]
            }
        };
        let weights: Vec<[f64; 4]> = render.fragile.iter().map(weights).collect();
        (
            weights.iter().flat_map(|w| [w[0], w[1], w[2]]).collect(),
            weights.iter().map(|w| w[3]).collect(),
        )
    }
}

impl ViewCase {
    /// Makes a case of camera `index` of `case`, its image `width` by `height`.
    pub fn new(
        name: &str,
        case: &TwinCase,
        index: usize,
        (width, height): (usize, usize),
        bounds: Bounds,
    ) -> ViewCase {
        ViewCase {
            name: format!("{name} {width}x{height}"),
            gaussians: case.gaussians.clone(),
            camera: case.cameras[index].resized(width, height),
            bounds,
            residual: Residual::Random,
        }
    }
}

/// Returns views whose numbers nearly cancel in single precision.
pub fn extreme_cases() -> Vec<ViewCase> {
    let size = (160, 104);
    let needles = distant_needles(60, 13);
    vec![
        ViewCase::new("0.1 degrees", &narrow(400, 11), 0, size, ORDINARY),
        ViewCase::new("camera at 1e-3", &beside(400, 12), 0, size, ORDINARY),
        ViewCase::new("needles from far outside", &needles, 0, size, NEEDLES),
    ]
}

/// Makes a case of camera 1 of `case`, each Gaussian left out with probability `percent` / 100.
pub fn dropout_case(case: &TwinCase, percent: u32, key: u32) -> ViewCase {
    let name = format!("dropout {percent} %");
    let mut view = ViewCase::new(&name, case, 1, (61, 47), ORDINARY);
    let threshold = u32::MAX / 100 * percent;
    let guide = None;
    view.camera.dropout = Some(TwinDropout {
        threshold,
        key,
        guide,
    });
    view
}

/// Makes the same as [`dropout_case`], guided by depth and density.
pub fn guided_dropout_case(case: &TwinCase, percent: u32, key: u32) -> ViewCase {
    let mut view = dropout_case(case, percent, key);
    view.name += ", guided";
    let means = &view.gaussians.means;
    let n = means.len() as f64;
    let densities = (0..means.len()).map(|i| f64::from((i as f64 / n) as f32));
    let weights = [0.5, 0.5];
    let guide = TwinGuide::new(weights, densities.collect(), means, &view.camera.center());
    if let Some(dropout) = &mut view.camera.dropout {
        dropout.guide = Some(guide);
    }
    view
}

/// Gaussians of the case that stages are timed on.
pub const TIMED_GAUSSIANS: usize = 20_000;
/// Width and height of that case's image, pixels.
pub const TIMED_SIZE: (usize, usize) = (320, 213);

/// Makes the case that stages are timed on.
pub fn timed_case() -> ViewCase {
    let case = random_scene(TIMED_GAUSSIANS, 3, 1);
    ViewCase::new("ordinary", &case, 0, TIMED_SIZE, ORDINARY)
}

/// Returns ordinary and unreasonable Gaussians at sizes even, odd and tiny.
pub fn small_cases() -> Vec<ViewCase> {
    let ordinary = |degree, seed| random_scene(400, degree, seed);
    vec![
        ViewCase::new("ordinary", &ordinary(2, 2), 1, (61, 47), ORDINARY),
        ViewCase::new("ordinary", &ordinary(3, 3), 3, (160, 104), ORDINARY),
        ViewCase::new("ordinary", &ordinary(1, 4), 0, (7, 5), ORDINARY),
        ViewCase::new("ordinary", &ordinary(0, 5), 0, (1, 1), ORDINARY),
        ViewCase::new("screen covers", &huge(60, 6), 0, (97, 63), COVERS),
        ViewCase::new("equal depths", &layers(8, 40, 7), 0, (81, 53), ORDINARY),
        ViewCase::new("needles", &needles(80, 8), 0, (160, 104), NEEDLES),
        dropout_case(&ordinary(2, 9), 40, 1),
        guided_dropout_case(&ordinary(2, 9), 90, 1),
    ]
}

/// Returns more than a loop may take on some drivers: a splat over 76,800 tiles, 100,000 splats in
/// a tile.
pub fn large_cases() -> Vec<ViewCase> {
    let crowd = crowd(100_000, 10, |_, random| random.uniform(0.0, 1.0) < 0.72);
    vec![
        ViewCase {
            residual: Residual::Constant,
            ..ViewCase::new("one splat", &cover(), 0, (1920, 1280), ORDINARY)
        },
        ViewCase::new("100,000 splats", &crowd, 0, (4, 8), ORDINARY),
    ]
}

/// Holds every stage of a view, forward and back, against the reference.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn examine(ctx: &Context, case: &ViewCase) -> Result<(Findings, ListLengths)> {
    let ViewCase {
        gaussians,
        camera,
        bounds,
        ..
    } = case;
    let twin = render(gaussians, camera);
    let (d_rgb, d_alpha) = case.residual.weights(&twin);
    let gradients = backward(gaussians, camera, &twin, &d_rgb, &d_alpha);
    let truth = Truth {
        rgb: &twin.rgb,
        alpha: &twin.alpha,
        fragile: &twin.fragile,
        d_rgb: &d_rgb,
        d_alpha: &d_alpha,
        classes: gradients.classes(),
    };
    let mut out = Findings::of(&case.name);
    let mut rig = Rig::of_twin(ctx, gaussians, camera)?;
    // Makes room for the pairs.
    rig.forward(ctx)?;
    let splats = &twin.projected;
    let lengths = forward::examine(ctx, &rig, camera, splats, bounds.projection, &mut out)?;
    let mut commands = Commands::new(&ctx.gpu);
    rig.pass(ctx).rasterize(&mut commands);
    commands.submit();
    let (rendered, rasterizer) = (rig.read_rendered(ctx)?, ctx.kernels.rasterizer);
    image::hold_image(&rendered, rasterizer, &truth, bounds.image, &mut out);
    let d_splats = gradients.splats.as_slice();
    let reference = TwinSplats {
        splats,
        gradients: d_splats,
    };
    let ours = image::examine_backward(ctx, &rig, reference, &truth, bounds.gradient, &mut out)?;
    image::hold_gradients(&ours, gaussians, camera, &truth, bounds.gradient, &mut out);
    let pose = pose_gradient(gaussians, camera, d_splats);
    pose::examine(ctx, &rig, &pose, bounds.gradient, &mut out)?;
    let twin = depth::Twin {
        render: &twin,
        gradients: &gradients,
        pose,
    };
    depth::examine(
        ctx,
        &rig,
        (gaussians, camera),
        &twin,
        (&d_rgb, &d_alpha),
        *bounds,
        &mut out,
    )?;
    Ok((out, lengths))
}
