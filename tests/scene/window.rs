//! Alpha channels that are windows, and those that cut out a subject.

use gspotential::scene::{Outside, Scene};
use image::{Rgba, RgbaImage};

use super::build::Folder;

const NAMES: [&str; 4] = ["a.png", "b.png", "c.png", "d.png"];

fn bytes(image: RgbaImage) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let written = image.write_to(&mut bytes, image::ImageFormat::Png);
    written.expect("a PNG");
    bytes.into_inner()
}

/// Photographs of 120x80 pixels that are opaque where `is_in` says so of the view and the place.
fn with_alpha(is_in: impl Fn(usize, f64, f64) -> bool) -> Scene {
    let folder = Folder::with_views(&NAMES);
    for (i, name) in NAMES.iter().enumerate() {
        let image = RgbaImage::from_fn(120, 80, |x, y| {
            let (u, v) = (f64::from(x) + 0.5 - 60.0, f64::from(y) + 0.5 - 40.0);
            Rgba([90, 60, 30, if is_in(i, u, v) { 255 } else { 0 }])
        });
        folder.write(&format!("images/{name}"), bytes(image));
    }
    folder.scene()
}

/// Whether a point of the image is within a rectangle of these half sides with corners of a radius.
fn rounded((across, down): (f64, f64), radius: f64) -> impl Fn(usize, f64, f64) -> bool {
    move |_, u, v| {
        let (du, dv) = (u.abs() - across + radius, v.abs() - down + radius);
        let is_box = u.abs() < across && v.abs() < down;
        is_box && (du < 0.0 || dv < 0.0 || du.hypot(dv) < radius)
    }
}

#[test]
fn an_alpha_channel_that_is_the_same_window_everywhere_is_ignored_and_told() {
    let corners = rounded((60.0, 40.0), 16.0);
    let border = rounded((56.0, 37.0), 0.0);
    let circle = |_: usize, u: f64, v: f64| u.hypot(v) < 39.0;
    let ellipse = |_: usize, u: f64, v: f64| (u / 60.0).hypot(v / 40.0) < 1.0;
    let turned =
        |_: usize, u: f64, v: f64| (u + 0.05 * v).abs() < 55.0 && (v - 0.05 * u).abs() < 35.0;
    let kinds: [&dyn Fn(usize, f64, f64) -> bool; 5] =
        [&corners, &border, &circle, &ellipse, &turned];
    for (k, is_in) in kinds.iter().enumerate() {
        let scene = with_alpha(is_in);
        for view in &scene.train {
            let mask = view.mask.as_ref().expect("a mask");
            assert_eq!(mask.outside, Outside::Ignored, "kind {k}");
            assert_eq!(view.image.rgb[..3], [90, 60, 30], "no background behind it");
        }
        assert!(
            scene
                .warnings
                .iter()
                .any(|w| w.contains("leave out the same border")),
            "kind {k}"
        );
        assert_eq!(scene.cloud.len(), 3);
    }
}

#[test]
fn an_alpha_channel_with_a_subject_cuts_it_out() {
    let small = rounded((29.0, 25.0), 8.0);
    // A figure with legs, as high as the image.
    let dented = |_: usize, u: f64, v: f64| u.abs() < 50.0 && (v < 0.0 || u.abs() > 20.0);
    // A box that fills the image, from elsewhere in each view.
    let moving = |i: usize, u: f64, v: f64| (u - 4.0 * i as f64).abs() < 50.0 && v.abs() < 38.0;
    let once = |i: usize, u: f64, v: f64| i == 0 && u.abs() < 24.0 || i > 0 && u.hypot(v) < 38.0;
    // A ball that is the same from everywhere.
    let ball = |_: usize, u: f64, v: f64| u.hypot(v) < 34.0;
    let kinds: [&dyn Fn(usize, f64, f64) -> bool; 5] = [&small, &dented, &moving, &once, &ball];
    for (k, is_in) in kinds.iter().enumerate() {
        let scene = with_alpha(is_in);
        for view in &scene.train {
            let mask = view.mask.as_ref().expect("a mask");
            assert_eq!(mask.outside, Outside::Background, "kind {k}");
            assert_eq!(view.image.rgb[..3], [0; 3], "the background behind it");
        }
        assert!(
            !scene.warnings.iter().any(|w| w.contains("same border")),
            "kind {k}"
        );
    }
}
