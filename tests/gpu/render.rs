//! Rendering and its gradient against the twins, end to end over projection, tile lists, sort and
//! compositing, both ways.

use std::io::Write;

use super::rig::{Context, Rig, assert_held, context, gaussians_of, view_of, wide};
use crate::twins::cases::{TwinCase, huge, layers, loss_weights, needles, random_scene};
use crate::twins::compare::max_abs_off_mask;
use crate::twins::linalg::{normalize, sub};
use crate::twins::model::{TwinCamera, TwinGaussians};
use crate::twins::raster::{TwinRender, backward, render};
use crate::twins::{sh, tolerance};

/// What single precision makes of a view.
pub struct Comparison {
    pub image: f64,
    pub image_fragile: f64,
    pub n_fragile: usize,
    /// Relative L2 by class.
    pub classes: Vec<(&'static str, f64)>,
}

/// What a view is held against.
pub struct Truth<'a> {
    pub rgb: &'a [f64],
    pub alpha: &'a [f64],
    pub fragile: &'a [bool],
    pub d_rgb: &'a [f64],
    pub d_alpha: &'a [f64],
    pub classes: [(&'static str, Vec<f64>); 5],
}

/// Renders, goes back, and compares; fails above the tolerances of image and gradients.
pub fn hold_view(
    ctx: &Context,
    name: &str,
    gaussians: &TwinGaussians,
    camera: &TwinCamera,
    truth: &Truth<'_>,
    (image_tolerance, gradient_tolerance): (f64, f64),
) -> Comparison {
    let degree = gaussians.sh_degree as u32;
    // Coefficients above the view's degree are there and must not matter.
    let mut rig = Rig::new(ctx, &gaussians_of(gaussians, 3), view_of(camera), degree);
    let image = rig.forward(ctx);
    let (rgb, alpha) = (wide(&image.rgb), wide(&image.alpha));
    let mut off = 0.0f64;
    let all: Vec<bool> = vec![false; truth.fragile.len()];
    let mut everywhere = 0.0f64;
    for (what, ours, theirs) in [("rgb", &rgb, truth.rgb), ("alpha", &alpha, truth.alpha)] {
        let error = max_abs_off_mask(ours, theirs, truth.fragile);
        assert!(
            error <= image_tolerance,
            "{name} {what}: differs by {error:e} > {image_tolerance:e}"
        );
        off = off.max(error);
        everywhere = everywhere.max(max_abs_off_mask(ours, theirs, &all));
        if let Some(pixel) = truth.fragile.iter().position(|fragile| !fragile) {
            let mut altered = ours.clone();
            altered[pixel * ours.len() / truth.fragile.len()] += 2.0 * image_tolerance;
            let error = max_abs_off_mask(&altered, theirs, truth.fragile);
            assert!(
                error > image_tolerance,
                "{name} {what}: an altered pixel passes"
            );
        }
    }
    assert!(
        everywhere <= tolerance::GPU_IMAGE_FRAGILE,
        "{name}: {everywhere:e} at fragile pixels"
    );

    let ours = rig.backward(ctx, truth.d_rgb, truth.d_alpha);
    let center = camera.center();
    let n_sh = (gaussians.sh_degree + 1).pow(2);
    let expanded: Vec<f64> = ours
        .color
        .iter()
        .zip(&gaussians.means)
        .flat_map(|(color, mean)| {
            let (direction, _) = normalize(&sub(mean, &center));
            let y = sh::basis(direction);
            (0..16)
                .flat_map(move |k| color.map(|c| if k < n_sh && c != 0.0 { y[k] * c } else { 0.0 }))
        })
        .collect();
    let classes = [
        &ours.means,
        &expanded,
        &ours.opacity_logit,
        &ours.scale_log,
        &ours.rotation_wxyz,
    ];
    let classes = truth
        .classes
        .iter()
        .zip(classes)
        .map(|((class, twin), ours)| {
            let what = format!("{name} {class}");
            (*class, assert_held(&what, ours, twin, gradient_tolerance))
        })
        .collect();
    Comparison {
        image: off,
        image_fragile: everywhere,
        n_fragile: truth.fragile.iter().filter(|f| **f).count(),
        classes,
    }
}

/// The table's head; rows are of [`row`].
pub fn table_head() -> String {
    "| view | image | at fragile | n fragile | means | sh | opacity | scales | quats |\n\
     |---|---|---|---|---|---|---|---|---|\n"
        .into()
}

pub fn row(name: &str, c: &Comparison) -> String {
    let classes: Vec<String> = c.classes.iter().map(|(_, e)| format!("{e:.1e}")).collect();
    format!(
        "| {name} | {:.1e} | {:.1e} | {} | {} |\n",
        c.image,
        c.image_fragile,
        c.n_fragile,
        classes.join(" | ")
    )
}

/// Prints past the test harness, which would keep it to itself.
pub fn print(text: &str) {
    let _ = std::io::stderr().write_all(text.as_bytes());
}

/// Holds every camera of a case, at its own size and the given ones.
pub fn hold_case(name: &str, case: &TwinCase, sizes: &[(usize, usize)], tolerances: (f64, f64)) {
    let mut table = table_head();
    for (index, camera) in case.cameras.iter().enumerate() {
        for &(width, height) in sizes {
            let camera = camera.resized(width, height);
            let twin: TwinRender = render(&case.gaussians, &camera);
            let (d_rgb, d_alpha) = loss_weights(&twin, 17 + index as u64);
            let gradients = backward(&case.gaussians, &camera, &twin, &d_rgb, &d_alpha);
            let truth = Truth {
                rgb: &twin.rgb,
                alpha: &twin.alpha,
                fragile: &twin.fragile,
                d_rgb: &d_rgb,
                d_alpha: &d_alpha,
                classes: gradients.classes(),
            };
            let name = format!("{name} {index} {width}x{height}");
            let ctx = context();
            let comparison = hold_view(&ctx, &name, &case.gaussians, &camera, &truth, tolerances);
            table += &row(&name, &comparison);
        }
    }
    print(&table);
}

pub const ORDINARY: (f64, f64) = (tolerance::GPU_IMAGE, tolerance::GPU_GRADIENT);

#[test]
fn random_scenes_match_the_twins_at_every_degree_and_odd_sizes() {
    for degree in 0..4 {
        let case = random_scene(400, degree, 40 + degree as u64);
        let sizes: &[(usize, usize)] = match degree {
            0 => &[(1, 1), (7, 5)],
            1 => &[(33, 17)],
            2 => &[(61, 47)],
            _ => &[(160, 104)],
        };
        hold_case(&format!("random {degree}"), &case, sizes, ORDINARY);
    }
}

#[test]
fn huge_gaussians_match_the_twins() {
    hold_case("huge", &huge(60, 5), &[(97, 63)], ORDINARY);
}

#[test]
fn layers_of_equal_depth_match_the_twins() {
    hold_case("layers", &layers(8, 40, 6), &[(81, 53)], ORDINARY);
    hold_case("500 layers", &layers(1, 500, 7), &[(81, 53)], ORDINARY);
}

#[test]
fn needles_match_the_twins() {
    let tolerances = (tolerance::GPU_NEEDLE_IMAGE, tolerance::GPU_NEEDLE_GRADIENT);
    hold_case("needles", &needles(80, 8), &[(160, 104)], tolerances);
}

#[test]
fn two_views_of_a_step_add_their_gradients() {
    use gspotential::gpu::Commands;
    use gspotential::render::{Bound, Capacity, Model, Pass, Workspace};

    let case = random_scene(200, 2, 91);
    let gaussians = gaussians_of(&case.gaussians, 2);
    let cameras = [
        case.cameras[0].resized(33, 17),
        case.cameras[1].resized(40, 29),
    ];
    let mut sum: Vec<Vec<f64>> = Vec::new();
    let mut colors: Vec<Vec<f64>> = Vec::new();
    let mut images = Vec::new();
    for camera in &cameras {
        let twin = render(&case.gaussians, camera);
        let weights = loss_weights(&twin, 5);
        let gradients = backward(&case.gaussians, camera, &twin, &weights.0, &weights.1);
        let classes = gradients.classes().map(|(_, values)| values);
        if sum.is_empty() {
            sum = classes.to_vec();
        } else {
            for (sum, class) in sum.iter_mut().zip(classes) {
                sum.iter_mut().zip(class).for_each(|(s, c)| *s += c);
            }
        }
        let color = gradients.splats.iter().zip(&twin.projected);
        colors.push(
            color
                .flat_map(|(d, s)| [0, 1, 2].map(|c| if s.rgb[c] > 0.0 { d[5 + c] } else { 0.0 }))
                .collect(),
        );
        images.push(weights);
    }

    let ctx = context();
    let gpu = &ctx.gpu;
    let views = cameras.each_ref().map(view_of);
    let model = Model::upload(gpu, &gaussians, gaussians.len()).expect("fits");
    let capacity = Capacity::new(model.stride, 1 << 16, &views);
    let mut rig = Rig {
        workspace: Workspace::new(gpu, capacity, true).expect("fits"),
        model,
        bound: Rig::new(&ctx, &gaussians, views[0], 2).bound,
        view: views[0],
        sh_degree: 2,
    };
    rig.bound = Bound::new(gpu, &ctx.kernels, &rig.workspace, &rig.model);
    rig.poison(&ctx);
    for (slot, view) in views.into_iter().enumerate() {
        rig.view = view;
        let (d_rgb, d_alpha) = &images[slot];
        let channel = |c: usize| -> Vec<f64> { d_rgb.iter().skip(c).step_by(3).copied().collect() };
        let planes = [channel(0), channel(1), channel(2)];
        rig.write_planes(
            &ctx,
            "d_rendered",
            [&planes[0], &planes[1], &planes[2], d_alpha],
            0.0,
        );
        let (space, bound) = (&rig.workspace, &rig.bound);
        let at = (slot, view);
        let pass = Pass::new(gpu, &ctx.kernels, space, bound, &rig.model, at, (2, 1));
        let mut commands = Commands::new(gpu);
        commands.clear(&space.totals);
        pass.forward(&mut commands);
        pass.backward(&mut commands);
        commands.submit();
    }
    let ours = rig.gradients(&ctx);
    for (what, ours, twin) in [
        ("means", &ours.means, &sum[0]),
        ("opacity", &ours.opacity_logit, &sum[2]),
        ("scales", &ours.scale_log, &sum[3]),
        ("rotations", &ours.rotation_wxyz, &sum[4]),
    ] {
        assert_held(what, ours, twin, tolerance::GPU_GRADIENT);
    }
    let d_color: Vec<[f32; 4]> = rig.read(&ctx, "d_color", 2 * rig.model.stride);
    for slot in 0..2 {
        let ours: Vec<f64> = d_color[slot * rig.model.stride..][..rig.model.n]
            .iter()
            .flat_map(|c| [c[0], c[1], c[2]].map(f64::from))
            .collect();
        let what = format!("colour of view {slot}");
        assert_held(&what, &ours, &colors[slot], tolerance::GPU_GRADIENT);
    }
}
