//! The twins against the reference cases on disk.

use gspotential::doctor::twin::model::TwinSplat;
use gspotential::doctor::twin::raster::{backward, render_with_tolerance};
use gspotential::doctor::twin::tolerance;

use super::fixture::{FixtureView, fixtures};
use super::{assert_close_off_mask, assert_relative_l2};

/// Calls `check` on every view of every case with a name for messages and its fragile tolerance.
fn each_view(check: impl Fn(&str, &FixtureView, f64)) {
    for fixture in fixtures() {
        for index in 0..fixture.n_views() {
            let name = format!("{} camera {index}", fixture.name);
            check(&name, &fixture.view(index), fixture.tolerance);
        }
    }
}

fn row(s: &TwinSplat) -> [f64; 14] {
    let ([u, v], [a, b, c], [xx, xy, yy], [red, green, blue]) = (s.mean2d, s.conic, s.cov2d, s.rgb);
    let valid = f64::from(u8::from(s.valid));
    [
        u, v, s.depth, a, b, c, xx, xy, yy, red, green, blue, s.opacity, valid,
    ]
}

#[test]
#[ignore = "needs ../shared/fixtures"]
fn images_match_the_references() {
    each_view(|name, view, fragile_tolerance| {
        let image = render_with_tolerance(&view.gaussians, &view.camera, fragile_tolerance);
        let close = |what: &str, a: &[f64], b: &[f64]| {
            let what = format!("{name} {what}");
            assert_close_off_mask(&what, a, b, &view.fragile, tolerance::REFERENCE_IMAGE);
        };
        close("rgb", &image.rgb, &view.rgb);
        close("alpha", &image.alpha, &view.alpha);
        let counts = |c: &[u32]| c.iter().map(|&c| f64::from(c)).collect::<Vec<_>>();
        close("count", &counts(&image.count), &counts(&view.count));
        // A close decision is close on both sides, but for rounding of the distance itself.
        let differ = image.fragile.iter().zip(&view.fragile);
        let differ = differ.filter(|(a, b)| a != b).count();
        assert!(differ <= 2, "{name}: {differ} pixels differ in fragility");
    });
}

#[test]
#[ignore = "needs ../shared/fixtures"]
fn projections_match_the_references() {
    each_view(|name, view, fragile_tolerance| {
        let image = render_with_tolerance(&view.gaussians, &view.camera, fragile_tolerance);
        let ours: Vec<[f64; 14]> = image.projected.iter().map(row).collect();
        for column in 0..14 {
            // Depth and validity of all, the rest of those in front.
            let pick = |rows: &[[f64; 14]]| -> Vec<f64> {
                rows.iter()
                    .zip(&view.projected)
                    .filter(|(_, reference)| matches!(column, 2 | 13) || reference[13] == 1.0)
                    .map(|(row, _)| row[column])
                    .collect()
            };
            let what = format!("{name} projected column {column}");
            let (a, b) = (pick(&ours), pick(&view.projected));
            assert_relative_l2(&what, &a, &b, tolerance::REFERENCE_GRADIENT);
        }
    });
}

#[test]
#[ignore = "needs ../shared/fixtures"]
fn gradients_match_the_references() {
    each_view(|name, view, fragile_tolerance| {
        let image = render_with_tolerance(&view.gaussians, &view.camera, fragile_tolerance);
        let (d_rgb, d_alpha) = (&view.d_rgb, &view.d_alpha);
        let gradients = backward(&view.gaussians, &view.camera, &image, d_rgb, d_alpha);
        let close = |what: &str, a: &[f64], b: &[f64]| {
            assert_relative_l2(
                &format!("{name} {what}"),
                a,
                b,
                tolerance::REFERENCE_GRADIENT,
            );
        };
        for ((class, a), (_, b)) in gradients.classes().iter().zip(view.gradients.classes()) {
            close(class, a, &b);
        }
        for column in 0..9 {
            let pick = |rows: &[[f64; 9]]| rows.iter().map(|r| r[column]).collect::<Vec<_>>();
            let (a, b) = (pick(&gradients.splats), pick(&view.gradients.splats));
            close(&format!("splat column {column}"), &a, &b);
        }
    });
}
