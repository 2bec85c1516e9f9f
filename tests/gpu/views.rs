//! Every stage of a view, forward and back, against the reference; two views in one step.

use std::io::Write;

use gspotential::doctor::twin::cases::{
    TwinCase, huge, layers, loss_weights, needles, random_scene,
};
use gspotential::doctor::twin::raster::{backward, render};
use gspotential::doctor::twin::tolerance;
use gspotential::doctor::view::{Bounds, COVERS, NEEDLES, ORDINARY, ViewCase, examine};
use gspotential::doctor::{Context, Findings, Rig, gaussians_of, stage, view_of};
use gspotential::gaussians::Gaussians;
use gspotential::gpu::shader::compose;
use gspotential::gpu::{Commands, Gpu, Rasterizer};
use gspotential::render::{Bound, Capacity, Model, Pass, PassStep, ViewUniform, Workspace};

use super::rig::{assert_findings, assert_held, context, context_of};

/// Prints past the test harness, which would keep it to itself.
pub(crate) fn print(text: &str) {
    let _ = std::io::stderr().write_all(text.as_bytes());
}

/// What tables show: a stage, and the quantities of it (all that begin so).
const COLUMNS: [(&str, &str); 11] = [
    (stage::PROJECT, ""),
    (stage::RASTERIZE, ""),
    (stage::RASTERIZE_BACKWARD, ""),
    (stage::PROJECT_BACKWARD, "means"),
    (stage::PROJECT_BACKWARD, "sh"),
    (stage::PROJECT_BACKWARD, "opacity"),
    (stage::PROJECT_BACKWARD, "scale"),
    (stage::PROJECT_BACKWARD, "rotation"),
    (stage::PROJECT_BACKWARD, "screen"),
    (stage::POSE_BACKWARD, "turn"),
    (stage::POSE_BACKWARD, "shift"),
];

/// The head of a table of [`row`]s: largest errors, images off fragile pixels.
pub(crate) fn table_head() -> String {
    let names = COLUMNS.map(|(stage, what)| if what.is_empty() { stage } else { what });
    format!(
        "| view | {} |\n|---{}|\n",
        names.join(" | "),
        "|---".repeat(COLUMNS.len())
    )
}

/// The largest errors of one view.
pub(crate) fn row(name: &str, findings: &Findings) -> String {
    let largest = COLUMNS.map(|(stage, what)| {
        // Whichever the rasterizer.
        let own = findings.list.iter().filter(|f| {
            f.stage.split(", ").next() == Some(stage)
                && f.what.starts_with(what)
                && !f.what.contains("fragile")
        });
        own.map(|f| f.error).max_by(f64::total_cmp)
    });
    let cells = largest.map(|error| error.map_or("".into(), |e| format!("{e:.1e}")));
    format!("| {name} | {} |\n", cells.join(" | "))
}

/// Holds one view with every rasterizer, and its tile lists to about what they need.
pub(crate) fn hold(case: &ViewCase) -> String {
    Rasterizer::ALL.map(|r| hold_with(r, case)).concat()
}

fn hold_with(rasterizer: Rasterizer, case: &ViewCase) -> String {
    let (findings, lengths) = examine(&context_of(rasterizer), case)
        .unwrap_or_else(|e| panic!("{}, {rasterizer}: {e}", case.name));
    assert_findings(&findings);
    // The lists are by rows of the ellipse: what they hold too much is its corners.
    assert!(
        lengths.listed as f64 <= 1.15 * lengths.needed as f64 + 50.0,
        "{}: lists are too long: {lengths:?}",
        case.name
    );
    assert!(
        lengths.listed <= lengths.boxes,
        "{}: {lengths:?}",
        case.name
    );
    row(&format!("{}, {rasterizer}", case.name), &findings)
}

/// Holds every camera of a case.
fn hold_case(name: &str, case: &TwinCase, sizes: &[(usize, usize)], bounds: Bounds) {
    let mut table = table_head();
    for index in 0..case.cameras.len() {
        for &size in sizes {
            let name = format!("{name} {index}");
            table += &hold(&ViewCase::new(&name, case, index, size, bounds));
        }
    }
    print(&table);
}

#[test]
fn random_scenes_match_the_reference_at_every_degree_and_odd_sizes() {
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
fn huge_gaussians_match_the_reference() {
    hold_case("huge", &huge(60, 5), &[(97, 63)], COVERS);
}

#[test]
fn layers_of_equal_depth_match_the_reference() {
    hold_case("layers", &layers(8, 40, 6), &[(81, 53)], ORDINARY);
    hold_case("500 layers", &layers(1, 500, 7), &[(81, 53)], ORDINARY);
}

#[test]
fn needles_match_the_reference() {
    hold_case("needles", &needles(80, 8), &[(160, 104)], NEEDLES);
}

/// Returns where the lists of the last of these views begin and end, rendered one after the other in the same buffers.
fn ranges_after(ctx: &Context, gaussians: &Gaussians, views: &[ViewUniform]) -> Vec<[u32; 2]> {
    let mut rig = Rig::new(ctx, gaussians, views[0], 0).expect("fits");
    rig.forward(ctx).expect("renders");
    for view in views {
        rig.view = *view;
        let mut commands = Commands::new(&ctx.gpu);
        commands.clear(rig.buffer("totals"));
        rig.pass(ctx).forward(&mut commands);
        commands.submit();
    }
    let n_tiles = ctx.kernels.rasterizer.n_tiles(rig.view.size);
    rig.read(ctx, "tile_ranges", n_tiles).expect("readable")
}

#[test]
fn a_tile_without_splats_keeps_no_list_of_an_earlier_view() {
    let case = random_scene(400, 0, 3);
    let gaussians = gaussians_of(&case.gaussians, 0);
    let whole = case.cameras[0].resized(160, 104);
    let mut half = whole.clone();
    // All Gaussians move to the right.
    half.cx += 100.0;
    let [whole, half] = [whole, half].each_ref().map(view_of);
    let after_and_alone = |ctx: &Context| {
        [&[whole, half][..], &[half]].map(|views| ranges_after(ctx, &gaussians, views))
    };
    for rasterizer in Rasterizer::ALL {
        let [after, alone] = after_and_alone(&context_of(rasterizer));
        assert!(after == alone, "{rasterizer}");
        let n_empty = alone.iter().filter(|range| range[0] == range[1]).count();
        assert!((10..alone.len() - 10).contains(&n_empty), "{n_empty}");
        // The comparison sees a list that is left.
        let planted = |stage: &str, degree: u32| {
            let source = compose(stage, degree);
            source.replace("].tile != tile)", "].tile == NO_TILE)")
        };
        assert_ne!(planted("tile_ranges", 0), compose("tile_ranges", 0));
        let gpu = Gpu::open().expect("an adapter");
        let [after, alone] = after_and_alone(&Context::from_sources(gpu, rasterizer, &planted));
        assert!(after != alone, "{rasterizer}");
    }
}

#[test]
fn two_views_of_a_step_add_their_gradients() {
    let case = random_scene(200, 2, 91);
    let gaussians = gaussians_of(&case.gaussians, 2);
    let cameras = [
        case.cameras[0].resized(33, 17),
        case.cameras[1].resized(40, 29),
    ];
    let mut sum: Vec<Vec<f64>> = Vec::new();
    let mut colors: Vec<Vec<f64>> = Vec::new();
    let mut weights = Vec::new();
    for camera in &cameras {
        let twin = render(&case.gaussians, camera);
        let (d_rgb, d_alpha) = loss_weights(&twin, 5);
        let gradients = backward(&case.gaussians, camera, &twin, &d_rgb, &d_alpha);
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
        weights.push((d_rgb, d_alpha));
    }

    let ctx = context();
    let gpu = &ctx.gpu;
    let views = cameras.each_ref().map(view_of);
    let model = Model::upload(gpu, &gaussians, gaussians.len()).expect("fits");
    let capacity = Capacity::new(ctx.kernels.rasterizer, model.stride, 1 << 16, &views);
    let workspace = Workspace::new(gpu, capacity, true).expect("fits");
    let mut rig = Rig {
        bound: Bound::new(gpu, &ctx.kernels, &workspace, &model),
        workspace,
        model,
        view: views[0],
        sh_degree: 2,
    };
    rig.poison(&ctx);
    for (slot, view) in views.into_iter().enumerate() {
        rig.view = view;
        let (d_rgb, d_alpha) = &weights[slot];
        rig.write_image(&ctx, "d_rendered", d_rgb, d_alpha, 0.0);
        let (space, bound) = (&rig.workspace, &rig.bound);
        let step = PassStep {
            slot,
            sh_degree: 2,
            number: 1,
        };
        let pass = Pass::new(gpu, &ctx.kernels, space, bound, &rig.model, view, step);
        let mut commands = Commands::new(gpu);
        commands.clear(space.buffer("totals"));
        pass.forward(&mut commands);
        pass.backward(&mut commands);
        commands.submit();
    }
    let ours = rig.gradients(&ctx).expect("readable");
    for (what, ours, twin) in [
        ("means", &ours.means, &sum[0]),
        ("opacity", &ours.opacity_logit, &sum[2]),
        ("scales", &ours.scale_log, &sum[3]),
        ("rotations", &ours.rotation_wxyz, &sum[4]),
    ] {
        assert_held(what, ours, twin, tolerance::GPU_GRADIENT);
    }
    let d_color: Vec<[f32; 4]> = rig
        .read(&ctx, "d_color", 2 * rig.model.stride)
        .expect("readable");
    for slot in 0..2 {
        let ours: Vec<f64> = d_color[slot * rig.model.stride..][..rig.model.n]
            .iter()
            .flat_map(|c| [c[0], c[1], c[2]].map(f64::from))
            .collect();
        let what = format!("colour of view {slot}");
        assert_held(&what, &ours, &colors[slot], tolerance::GPU_GRADIENT);
    }
}
