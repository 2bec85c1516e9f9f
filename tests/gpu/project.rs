//! Projection against its twin, on random scenes and on a reference case.

use super::rig::{Context, Rig, assert_held, context, gaussians_of, view_of};
use crate::reference::fixture::fixtures;
use gspotential::reference::cases::{TwinCase, huge, needles, random_scene};
use gspotential::reference::model::{TwinCamera, TwinGaussians, TwinSplat};
use gspotential::reference::project::project;
use gspotential::reference::raster::ALPHA_MIN;
use gspotential::reference::tolerance;

/// `u, v, depth, A, B, C, r, g, b, opacity` of a splat as the GPU stores it; `None` where it is
/// not drawn. The conic is stored as its Cholesky factor scaled by `sqrt(log2(e) / 2)`.
pub fn decode(ctx: &Context, rig: &Rig) -> Vec<Option<[f64; 10]>> {
    let stride = rig.model.stride;
    let planes: Vec<[f32; 4]> = rig.read(ctx, "splats", 3 * stride);
    let two_ln_2 = 2.0 * std::f64::consts::LN_2;
    (0..rig.model.n)
        .map(|i| {
            let [u, v, l_xx, l_xy] = planes[i].map(f64::from);
            let [l_yy, opacity, depth, reach] = planes[stride + i].map(f64::from);
            let [r, g, b, _] = planes[2 * stride + i].map(f64::from);
            (reach > 0.0).then_some([
                u,
                v,
                depth,
                two_ln_2 * l_xx * l_xx,
                two_ln_2 * l_xx * l_xy,
                two_ln_2 * (l_xy * l_xy + l_yy * l_yy),
                r,
                g,
                b,
                opacity,
            ])
        })
        .collect()
}

fn row(s: &TwinSplat) -> [f64; 10] {
    let ([u, v], [a, b, c], [red, green, blue]) = (s.mean2d, s.conic, s.rgb);
    [u, v, s.depth, a, b, c, red, green, blue, s.opacity]
}

fn hold(name: &str, gaussians: &TwinGaussians, camera: &TwinCamera, tolerance: f64) {
    let twin: Vec<TwinSplat> = (0..gaussians.len())
        .map(|i| project(gaussians, i, camera))
        .collect();
    let ctx = context();
    let degree = gaussians.sh_degree as u32;
    let mut rig = Rig::new(&ctx, &gaussians_of(gaussians, 3), view_of(camera), degree);
    rig.forward(&ctx);
    let ours = decode(&ctx, &rig);
    let (mut drawn, mut expected) = (Vec::new(), Vec::new());
    for (i, (ours, twin)) in ours.iter().zip(&twin).enumerate() {
        let visible = twin.valid && twin.opacity > ALPHA_MIN;
        assert_eq!(ours.is_some(), visible, "{name}: Gaussian {i} {twin:?}");
        if let Some(ours) = ours {
            drawn.push(*ours);
            expected.push(row(twin));
        }
    }
    assert!(!drawn.is_empty(), "{name}: nothing to compare");
    let columns = ["u", "v", "depth", "A", "B", "C", "r", "g", "b", "opacity"];
    for (c, column) in columns.into_iter().enumerate() {
        let pick = |rows: &[[f64; 10]]| rows.iter().map(|r| r[c]).collect::<Vec<_>>();
        let what = format!("{name} {column}");
        assert_held(&what, &pick(&drawn), &pick(&expected), tolerance);
    }
}

fn hold_case(name: &str, case: &TwinCase, tolerance: f64) {
    for (i, camera) in case.cameras.iter().enumerate() {
        hold(&format!("{name} {i}"), &case.gaussians, camera, tolerance);
    }
}

#[test]
fn projections_match_the_twins() {
    for degree in 0..4 {
        let case = random_scene(500, degree, 60 + degree as u64);
        hold_case("random", &case, tolerance::GPU_PROJECTION);
    }
    hold_case("huge", &huge(60, 61), tolerance::GPU_PROJECTION);
    hold_case("needles", &needles(80, 62), tolerance::GPU_PROJECTION);
}

#[test]
fn projections_of_reference_cases_match_the_twins() {
    for fixture in fixtures() {
        for index in 0..fixture.n_views() {
            let view = fixture.view(index);
            let name = format!("{} {index}", fixture.name);
            let tolerance = tolerance::GPU_PROJECTION;
            hold(&name, &view.gaussians, &view.camera, tolerance);
        }
    }
}
