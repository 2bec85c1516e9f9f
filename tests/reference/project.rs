//! SH and the projection against their definitions and against central differences.

use gspotential::doctor::twin::cases::{self, TwinCase};
use gspotential::doctor::twin::dropout::TwinDropout;
use gspotential::doctor::twin::linalg::{Vec3, dot, normalize};
use gspotential::doctor::twin::model::{SplatGradient, TwinCamera, TwinGaussians, TwinSplat};
use gspotential::doctor::twin::project::{RawGradient, project, project_backward};
use gspotential::doctor::twin::random::Random;
use gspotential::doctor::twin::{sh, tolerance};

use super::assert_relative_l2;

/// Fourth-order central difference of `f` at 0.
pub(crate) fn central_difference(f: impl Fn(f64) -> f64) -> f64 {
    let h = tolerance::STEP;
    (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
}

/// Raw parameters of a Gaussian, flattened: mean 3, SH 48, opacity 1, scale 3, rotation 4.
pub(crate) const N_RAW: usize = 59;

/// Names and ranges of the classes in the flattened parameters.
pub(crate) const CLASSES: [(&str, std::ops::Range<usize>); 5] = [
    ("mean", 0..3),
    ("sh", 3..51),
    ("opacity_logit", 51..52),
    ("scale_log", 52..55),
    ("rotation_wxyz", 55..59),
];

/// Parameter `k` (flattened) of Gaussian `i`.
pub(crate) fn parameter(gaussians: &mut TwinGaussians, i: usize, k: usize) -> &mut f64 {
    match k {
        0..3 => &mut gaussians.means[i][k],
        3..51 => &mut gaussians.sh[i][(k - 3) / 3][(k - 3) % 3],
        51 => &mut gaussians.opacity_logit[i],
        52..55 => &mut gaussians.scale_log[i][k - 52],
        _ => &mut gaussians.rotation_wxyz[i][k - 55],
    }
}

fn flatten(g: &RawGradient) -> Vec<f64> {
    let mut flat = g.mean.to_vec();
    flat.extend_from_slice(g.sh.as_flattened());
    flat.push(g.opacity_logit);
    flat.extend_from_slice(&g.scale_log);
    flat.extend_from_slice(&g.rotation_wxyz);
    flat
}

fn outputs(s: &TwinSplat) -> SplatGradient {
    let ([u, v], [a, b, c], [red, green, blue]) = (s.mean2d, s.conic, s.rgb);
    [u, v, a, b, c, red, green, blue, s.opacity]
}

fn unit(random: &mut Random) -> Vec3 {
    normalize(&[(); 3].map(|()| random.normal())).0
}

/// Checks the projection of every valid Gaussian in every camera, one output at a time, so that
/// a small gradient is not hidden by a large one. Returns how many Gaussians were clamped.
fn check_projection(name: &str, case: &TwinCase) -> usize {
    let mut n_clamped = 0;
    for camera in &case.cameras {
        for i in 0..case.gaussians.n() {
            let splat = project(&case.gaussians, i, camera);
            let p = camera.to_camera(&case.gaussians.means[i]);
            let bounds = camera.tangent_bounds();
            let beyond = |axis: usize| {
                let tangent = p[axis] / p[2];
                tangent < bounds[axis][0] || tangent > bounds[axis][1]
            };
            if !splat.valid {
                let zero = project_backward(&case.gaussians, i, camera, &[1.0; 9]);
                assert!(flatten(&zero).iter().all(|&x| x == 0.0));
                continue;
            }
            n_clamped += usize::from(beyond(0) || beyond(1));
            let [xx, xy, yy] = splat.cov2d;
            // The conic is rounded like its largest entry, times the determinant's cancellation.
            let mut sizes = outputs(&splat).map(f64::abs);
            let conic = sizes[2].max(sizes[4]);
            sizes[2..5].fill(conic * (1.0 + xx * yy / (xx * yy - xy * xy)));
            for (output, size) in sizes.into_iter().enumerate() {
                let mut d = [0.0; 9];
                d[output] = 1.0;
                let backward = flatten(&project_backward(&case.gaussians, i, camera, &d));
                let forward = differences(case, camera, i, output);
                for (class, range) in CLASSES {
                    let (a, b) = (&backward[range.clone()], &forward[range]);
                    let rounding = 4e-15 * size / tolerance::STEP;
                    let off = norm(a.iter().zip(b).map(|(a, b)| a - b));
                    let norm = norm(a.iter().copied());
                    assert!(
                        off <= tolerance::FINITE_DIFFERENCE * norm + rounding,
                        "{name}: {class} of Gaussian {i}, output {output}: off {off:e} of {norm:e}"
                    );
                }
            }
        }
    }
    n_clamped
}

fn norm(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|x| x * x).sum::<f64>().sqrt()
}

fn differences(case: &TwinCase, camera: &TwinCamera, i: usize, output: usize) -> Vec<f64> {
    (0..N_RAW)
        .map(|k| {
            central_difference(|h| {
                let mut one = single(&case.gaussians, i);
                *parameter(&mut one, 0, k) += h;
                outputs(&project(&one, 0, camera))[output]
            })
        })
        .collect()
}

fn single(g: &TwinGaussians, i: usize) -> TwinGaussians {
    TwinGaussians {
        means: vec![g.means[i]],
        sh: vec![g.sh[i]],
        opacity_logit: vec![g.opacity_logit[i]],
        scale_log: vec![g.scale_log[i]],
        rotation_wxyz: vec![g.rotation_wxyz[i]],
        sh_degree: g.sh_degree,
    }
}

#[test]
fn projection_gradients_match_central_differences() {
    for sh_degree in 0..4 {
        let case = cases::random_scene(40, sh_degree, 11 + sh_degree as u64);
        let n_clamped = check_projection("random", &case);
        assert!(
            n_clamped > 5,
            "only {n_clamped} beyond the Jacobian's bounds"
        );
    }
}

#[test]
fn projection_gradients_of_needles_match_central_differences() {
    check_projection("needles", &cases::needles(40, 21));
}

#[test]
fn projection_gradients_of_huge_gaussians_match_central_differences() {
    let n_clamped = check_projection("huge", &cases::huge(40, 31));
    assert!(
        n_clamped > 20,
        "only {n_clamped} beyond the Jacobian's bounds"
    );
}

#[test]
fn dropout_leaves_out_or_brightens_and_so_do_the_gradients() {
    let case = cases::random_scene(60, 1, 12);
    let camera = TwinCamera {
        dropout: Some(TwinDropout {
            threshold: 1 << 30,
            key: 9,
            guide: None,
        }),
        ..case.cameras[0].clone()
    };
    let mut n_dropped = 0;
    for i in 0..case.gaussians.n() {
        let plain = project(&case.gaussians, i, &case.cameras[0]);
        let ours = project(&case.gaussians, i, &camera);
        let mut d = [0.0; 9];
        d[8] = 1.0;
        let gradient = project_backward(&case.gaussians, i, &camera, &d);
        if !ours.valid {
            n_dropped += usize::from(plain.valid);
            assert!(flatten(&gradient).iter().all(|&x| x == 0.0));
            continue;
        }
        assert!((ours.opacity - plain.opacity / 0.75).abs() < 1e-15);
        let difference = central_difference(|h| {
            let mut moved = case.gaussians.clone();
            moved.opacity_logit[i] += h;
            project(&moved, i, &camera).opacity
        });
        let off = (gradient.opacity_logit - difference).abs();
        assert!(off < tolerance::FINITE_DIFFERENCE * difference);
    }
    assert!((5..25).contains(&n_dropped), "{n_dropped} of 60");
}

#[test]
fn sh_bases_are_orthonormal() {
    // Gauss-Legendre would do; a fine midpoint rule in z and the angle is exact in the angle and
    // good to 1e-6 in z.
    let (n_z, n_phi) = (2000, 16);
    let mut products = [[0.0; 16]; 16];
    for iz in 0..n_z {
        let z = (2.0 * iz as f64 + 1.0) / n_z as f64 - 1.0;
        let r = (1.0 - z * z).sqrt();
        for ip in 0..n_phi {
            let (sin, cos) = (std::f64::consts::TAU * ip as f64 / n_phi as f64).sin_cos();
            let y = sh::basis([r * cos, r * sin, z]);
            let area = 4.0 * std::f64::consts::PI / f64::from(n_z * n_phi);
            for (i, row) in products.iter_mut().enumerate() {
                for (j, sum) in row.iter_mut().enumerate() {
                    *sum += area * y[i] * y[j];
                }
            }
        }
    }
    for (i, row) in products.iter().enumerate() {
        for (j, product) in row.iter().enumerate() {
            let expected = f64::from(u8::from(i == j));
            assert!((product - expected).abs() < 1e-5, "<{i}, {j}> = {product}");
        }
    }
}

#[test]
fn sh_bases_have_the_signs_and_order_of_3dgs_files() {
    // Values of the published decimal constants at one direction off every symmetry.
    let [x, y, z] = [0.48, 0.6, 0.64];
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let expected = [
        0.28209479177387814,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2.0 * zz - xx - yy),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3.0 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4.0 * zz - xx - yy),
        0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.4570457994644658 * x * (4.0 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3.0 * yy),
    ];
    for (k, (a, b)) in sh::basis([x, y, z]).iter().zip(expected).enumerate() {
        assert!((a - b).abs() < 1e-12, "Y_{k}: {a} against {b}");
    }
}

#[test]
fn sh_basis_gradients_match_central_differences() {
    let mut random = Random::new(5);
    for _ in 0..20 {
        let (d, along) = (unit(&mut random), unit(&mut random));
        let gradient = sh::basis_gradient(d);
        for (k, gradient) in gradient.iter().enumerate() {
            let forward = central_difference(|h| {
                sh::basis(std::array::from_fn(|axis| d[axis] + h * along[axis]))[k]
            });
            let backward = dot(gradient, &along);
            assert!((forward - backward).abs() < 1e-8, "Y_{k}");
        }
    }
}

#[test]
fn coefficients_above_the_active_degree_do_nothing() {
    let mut random = Random::new(6);
    let direction = unit(&mut random);
    let mut coefficients = [(); 16].map(|()| [random.normal(), 0.0, 0.0]);
    for degree in 0..4 {
        let n = (degree + 1usize).pow(2);
        let before = sh::color(direction, &coefficients, degree);
        coefficients[n..].fill([9.0; 3]);
        assert_eq!(sh::color(direction, &coefficients, degree), before);
        coefficients[n - 1][0] += 1.0;
        assert_ne!(sh::color(direction, &coefficients, degree), before);
    }
}

#[test]
fn a_sphere_on_the_axis_projects_to_a_dilated_circle() {
    // On the axis at depth z a sphere of scale s has the covariance (f s / z)^2 + 0.3.
    let camera = cases::looking_at([0.0; 3], [0.0, 0.0, 1.0]);
    let gaussians = TwinGaussians {
        means: vec![[0.0, 0.0, 2.0]],
        sh: vec![[[0.0; 3]; 16]],
        opacity_logit: vec![0.0],
        scale_log: vec![[0.1f64.ln(); 3]],
        rotation_wxyz: vec![[0.3, -1.0, 2.0, 0.7]],
        sh_degree: 0,
    };
    let splat = project(&gaussians, 0, &camera);
    let variance = (camera.fx * 0.1 / 2.0).powi(2) + 0.3;
    assert_eq!(splat.mean2d, [camera.cx, camera.cy]);
    assert_relative_l2(
        "circle",
        &[splat.cov2d, splat.conic].concat(),
        &[variance, 0.0, variance, 1.0 / variance, 0.0, 1.0 / variance],
        1e-14,
    );
    assert_eq!((splat.rgb, splat.opacity), ([0.5; 3], 0.5));
    let at_near = TwinCamera {
        near: 2.0,
        ..camera
    };
    assert!(!project(&gaussians, 0, &at_near).valid);
}

#[test]
fn the_jacobian_is_clamped_15_percent_of_the_image_beyond_its_edges() {
    let camera = TwinCamera {
        width: 100,
        height: 60,
        fx: 50.0,
        fy: 40.0,
        cx: 50.0,
        cy: 20.0,
        ..cases::looking_at([0.0; 3], [0.0, 0.0, 1.0])
    };
    // Centred: 1.3 tan(fov / 2) on either side. Off-centre: -(20 + 9) / 40 and (40 + 9) / 40.
    let [[left, right], [top, bottom]] = camera.tangent_bounds();
    let bounds = [left, right, top, bottom];
    assert_relative_l2("bounds", &bounds, &[-1.3, 1.3, -0.725, 1.225], 1e-15);
}
