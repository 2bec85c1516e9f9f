//! Rational and fisheye models.

use super::*;

type Bend = fn(&[f64], DVec2) -> DVec2;

/// COLMAP's definitions (colmap/sensor/models.h), by the parameters behind the principal point.
fn full_opencv(k: &[f64], p: DVec2) -> DVec2 {
    let r2 = p.length_squared();
    let above = 1.0 + k[0] * r2 + k[1] * r2.powi(2) + k[4] * r2.powi(3);
    let below = 1.0 + k[5] * r2 + k[6] * r2.powi(2) + k[7] * r2.powi(3);
    let uv = p.x * p.y;
    p * (above / below)
        + DVec2::new(
            2.0 * k[2] * uv + k[3] * (r2 + 2.0 * p.x * p.x),
            2.0 * k[3] * uv + k[2] * (r2 + 2.0 * p.y * p.y),
        )
}

fn opencv_fisheye(k: &[f64], p: DVec2) -> DVec2 {
    let theta = p.length().atan();
    let t2 = theta * theta;
    let bent =
        theta * (1.0 + k[0] * t2 + k[1] * t2.powi(2) + k[2] * t2.powi(3) + k[3] * t2.powi(4));
    p.normalize_or_zero() * bent
}

fn thin_prism_fisheye(k: &[f64], p: DVec2) -> DVec2 {
    let q = p.normalize_or_zero() * p.length().atan();
    let (r2, uv) = (q.length_squared(), q.x * q.y);
    let radial = k[0] * r2 + k[1] * r2.powi(2) + k[4] * r2.powi(3) + k[5] * r2.powi(4);
    q + q * radial
        + DVec2::new(
            2.0 * k[2] * uv + k[3] * (r2 + 2.0 * q.x * q.x) + k[6] * r2,
            2.0 * k[3] * uv + k[2] * (r2 + 2.0 * q.y * q.y) + k[7] * r2,
        )
}

/// What a lens that is defined by where rays go shows of the pattern.
fn seen_through(bend: Bend, k: &[f64], focal: f64) -> Vec<u8> {
    let image = RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let goal = DVec2::new(
            (f64::from(x) + 0.5 - PRINCIPAL[0]) / focal,
            (f64::from(y) + 0.5 - PRINCIPAL[1]) / focal,
        );
        let mut p = goal;
        for _ in 0..4000 {
            p += 0.5 * (goal - bend(k, p));
        }
        let known = (bend(k, p) - goal).length() < 1e-9;
        let seen = if known {
            pattern(p)
        } else {
            [255.0, 0.0, 255.0]
        };
        Rgb(seen.map(|v| v.round() as u8))
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("a PNG");
    bytes.into_inner()
}

/// A model, its definition, its coefficients, and the focal length.
type Lens = (&'static str, Bend, &'static [f64], f64);

const OTHERS: [Lens; 5] = [
    (
        "FULL_OPENCV",
        full_opencv,
        &[0.1, -0.05, 0.004, -0.006, 0.01, 0.02, -0.01, 0.003],
        84.0,
    ),
    (
        "OPENCV_FISHEYE",
        opencv_fisheye,
        &[0.02, -0.01, 0.003, -0.001],
        60.0,
    ),
    ("OPENCV_FISHEYE", opencv_fisheye, &[0.0; 4], 40.0),
    ("THIN_PRISM_FISHEYE", thin_prism_fisheye, &[0.0; 8], 60.0),
    (
        "THIN_PRISM_FISHEYE",
        thin_prism_fisheye,
        &[0.03, -0.01, 0.004, -0.003, 0.002, 0.001, 0.005, -0.004],
        60.0,
    ),
];

#[test]
fn rational_and_fisheye_lenses_are_undone_by_their_definitions() {
    for (model, bend, k, focal) in OTHERS {
        let photograph = seen_through(bend, k, focal);
        let params = [&[focal, focal, PRINCIPAL[0], PRINCIPAL[1]], k].concat();
        let scene = folder(model, &params, &photograph).scene();
        let view = &scene.train[0];
        let (mean, greatest) = errors(view);
        eprintln!(
            "{model} {k:?}: mean {mean:.3}, greatest {greatest:.2}, {:?}",
            scene.warnings
        );
        assert!(
            mean < 1.5 && greatest < 25.0,
            "{model} {k:?}: {mean} {greatest}"
        );
        // Another lens is seen.
        for i in 0..k.len() {
            let mut wrong = params.clone();
            wrong[4 + i] += if i < 2 { 0.1 } else { 0.3 };
            if let Ok(scene) = folder(model, &wrong, &photograph).load() {
                let (other, _) = errors(&scene.train[0]);
                assert!(
                    other > 1.5 * mean.max(0.5),
                    "{model}, coefficient {i}: {other} {mean}"
                );
            }
        }
        let camera = &view.camera;
        assert_eq!([camera.fx, camera.fy], [focal, focal]);
        let is_fisheye = model.ends_with("FISHEYE");
        let told = scene
            .warnings
            .iter()
            .any(|w| w.contains("fisheye photographs became pinhole"));
        assert_eq!(told, is_fisheye, "{:?}", scene.warnings);
        if is_fisheye {
            // 55 degrees to each side at most.
            let bound = focal * 55.0_f64.to_radians().tan() + 1.0;
            let sides = [camera.cx, f64::from(camera.width) - camera.cx, camera.cy];
            assert!(sides.iter().all(|side| *side <= bound), "{camera:?}");
        }
    }
}

#[test]
fn models_with_zeros_are_their_simpler_selves() {
    let f = FOCAL[0];
    let [cx, cy] = PRINCIPAL;
    let k = [-0.1, 0.02, 0.001, -0.002];
    let photograph = photograph(k);
    let zeros = |params: &[f64], n: usize| [params, &vec![0.0; n]].concat();
    for (model, params, simple, same) in [
        (
            "FULL_OPENCV",
            zeros(&opencv([0.0; 4]), 4),
            "PINHOLE",
            opencv([0.0; 4])[..4].to_vec(),
        ),
        ("FULL_OPENCV", zeros(&opencv(k), 4), "OPENCV", opencv(k)),
        (
            "SIMPLE_RADIAL_FISHEYE",
            vec![f, cx, cy, 0.0],
            "OPENCV_FISHEYE",
            zeros(&[f, f, cx, cy], 4),
        ),
        (
            "RADIAL_FISHEYE",
            vec![f, cx, cy, 0.01, 0.0],
            "OPENCV_FISHEYE",
            vec![f, f, cx, cy, 0.01, 0.0, 0.0, 0.0],
        ),
        (
            "FISHEYE",
            vec![f, f, cx, cy],
            "SIMPLE_FISHEYE",
            vec![f, cx, cy],
        ),
        (
            "THIN_PRISM_FISHEYE",
            zeros(&[f, f, cx, cy], 8),
            "OPENCV_FISHEYE",
            zeros(&[f, f, cx, cy], 4),
        ),
    ] {
        let a = folder(model, &params, &photograph).scene();
        let b = folder(simple, &same, &photograph).scene();
        assert_eq!(a.train[0].camera, b.train[0].camera, "{model}");
        assert_eq!(a.train[0].image, b.train[0].image, "{model}");
        assert_eq!(a.warnings, b.warnings, "{model}");
    }
}
