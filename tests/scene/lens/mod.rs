//! Distorted cameras: photographs of a known pattern, undistorted on load.

mod opencv;
mod others;

use crate::scene::build::{Folder, GOOD_PLY, images_txt, options, png};
use glam::DVec2;
use gspotential::camera::Camera;
use gspotential::scene::{LoadOptions, View};
use image::{Rgb, RgbImage};

const SIZE: (u32, u32) = (120, 90);

const FOCAL: [f64; 2] = [84.0, 88.0];

const PRINCIPAL: [f64; 2] = [57.0, 47.5];

/// The definition of COLMAP's OPENCV model (colmap/sensor/models.h), and of OpenCV.
fn distort([k1, k2, p1, p2]: [f64; 4], p: DVec2) -> DVec2 {
    let (u, v) = (p.x, p.y);
    let (u2, uv, v2) = (u * u, u * v, v * v);
    let r2 = u2 + v2;
    let radial = k1 * r2 + k2 * r2 * r2;
    DVec2::new(
        u + u * radial + 2.0 * p1 * uv + p2 * (r2 + 2.0 * u2),
        v + v * radial + 2.0 * p2 * uv + p1 * (r2 + 2.0 * v2),
    )
}

/// By fixed-point iteration, which has nothing of Newton's method; `None` where the model has
/// folded before it gets there.
fn undistort(coefficients: [f64; 4], goal: DVec2) -> Option<DVec2> {
    let mut p = goal;
    for _ in 0..300 {
        p += 0.5 * (goal - distort(coefficients, p));
    }
    ((distort(coefficients, p) - goal).length() < 1e-12).then_some(p)
}

/// What lies on the plane at depth 1.
fn pattern(p: DVec2) -> [f64; 3] {
    [
        128.0 + 110.0 * (9.0 * p.x + 1.0).sin() * (7.0 * p.y).cos(),
        128.0 + 110.0 * (8.0 * p.y - 4.0 * p.x).sin(),
        100.0 + 90.0 * p.x - 60.0 * p.y,
    ]
}

fn photograph(coefficients: [f64; 4]) -> Vec<u8> {
    let image = RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let distorted = DVec2::new(
            (f64::from(x) + 0.5 - PRINCIPAL[0]) / FOCAL[0],
            (f64::from(y) + 0.5 - PRINCIPAL[1]) / FOCAL[1],
        );
        let seen = undistort(coefficients, distorted).map(pattern);
        Rgb(seen.unwrap_or([255.0, 0.0, 255.0]).map(|v| v.round() as u8))
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("a PNG");
    bytes.into_inner()
}

/// A scene of one photograph by a camera of this model.
fn folder(model: &str, params: &[f64], photograph: &[u8]) -> Folder {
    let folder = Folder::empty();
    let params: Vec<String> = params.iter().map(f64::to_string).collect();
    let camera = format!("1 {model} {} {} {}\n", SIZE.0, SIZE.1, params.join(" "));
    folder.write("sparse/0/cameras.txt", camera);
    folder.write("sparse/0/images.txt", images_txt(&["a.png"]));
    folder.write("sparse/0/points3D.ply", GOOD_PLY);
    folder.write("images/a.png", photograph);
    folder
}

fn opencv([k1, k2, p1, p2]: [f64; 4]) -> Vec<f64> {
    let ([fx, fy], [cx, cy]) = (FOCAL, PRINCIPAL);
    vec![fx, fy, cx, cy, k1, k2, p1, p2]
}

fn ray(camera: &Camera, u: f64, v: f64) -> DVec2 {
    DVec2::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
}

/// Mean and greatest difference of the image from what its camera should see.
fn errors(view: &View) -> (f64, f64) {
    let camera = &view.camera;
    assert_eq!(
        (view.image.width, view.image.height),
        (camera.width, camera.height)
    );
    let (mut sum, mut greatest) = (0.0, 0.0f64);
    for (i, pixel) in view.image.rgb.chunks_exact(3).enumerate() {
        let (x, y) = (i as u32 % camera.width, i as u32 / camera.width);
        let seen = pattern(ray(camera, f64::from(x) + 0.5, f64::from(y) + 0.5));
        for (a, b) in pixel.iter().zip(seen) {
            let error = (f64::from(*a) - b.clamp(0.0, 255.0)).abs();
            sum += error;
            greatest = greatest.max(error);
        }
    }
    (sum / view.image.rgb.len() as f64, greatest)
}
