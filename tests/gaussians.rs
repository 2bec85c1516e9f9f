//! The Gaussians that training starts from.

use glam::{DVec3, Vec3, dvec3};
use gspotential::camera::Frame;
use gspotential::gaussians::Gaussians;
use gspotential::gaussians::splat::write_splat;

use crate::gaussians_ply::distinct;
use crate::geometry::{Random, cloud, paper};

fn start(positions: Vec<DVec3>) -> Gaussians {
    Gaussians::from_cloud(&cloud(positions), &Frame::IDENTITY, &paper().model).unwrap()
}

fn scales(positions: Vec<DVec3>) -> Vec<f64> {
    let scale = |s: &Vec3| {
        assert!(s.x == s.y && s.y == s.z, "not isotropic: {s}");
        f64::from(s.x).exp()
    };
    start(positions).scales_log.iter().map(scale).collect()
}

fn close(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < 1e-5
}

#[test]
fn scales_equal_the_brute_force_neighbour_distances() {
    let mut random = Random::new(11);
    let mut positions: Vec<DVec3> = (0..600).map(|_| random.in_cube(1.0)).collect();
    // Pairs, triples and quadruples at one place.
    for n_copies in [2, 3, 4, 5] {
        let place = random.in_cube(1.0);
        positions.extend(std::iter::repeat_n(place, n_copies));
    }
    let scales = scales(positions.clone());
    let rounded: Vec<DVec3> = positions.iter().map(|p| p.as_vec3().as_dvec3()).collect();
    let twins: Vec<f64> = rounded
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let mut squared: Vec<f64> = rounded
                .iter()
                .enumerate()
                .filter(|(j, _)| *j != i)
                .map(|(_, q)| p.distance_squared(*q))
                .collect();
            squared.sort_by(f64::total_cmp);
            (squared[..3].iter().sum::<f64>() / 3.0).max(1e-7).sqrt()
        })
        .collect();
    for (i, (scale, twin)) in scales.iter().zip(&twins).enumerate() {
        assert!(close(*scale, *twin), "{i}: {scale} for {twin}");
    }
}

#[test]
fn an_isolated_point_starts_as_large_as_its_distances_say() {
    let mut positions: Vec<DVec3> = (0..100)
        .map(|i| dvec3(f64::from(i % 10), f64::from(i / 10), 0.0) * 0.1)
        .collect();
    positions.push(dvec3(0.0, 0.0, 50.0));
    let scales = scales(positions);
    assert!(close(scales[55], 0.1));
    let squared = |near: f64| 2500.0 + near;
    let expected = ((squared(0.0) + 2.0 * squared(0.01)) / 3.0).sqrt();
    assert!(close(scales[100], expected), "{}", scales[100]);
}

#[test]
fn clouds_of_few_points_start_with_sensible_scales() {
    assert!(close(scales(vec![DVec3::ONE])[0], 0.01));
    let two = scales(vec![DVec3::ZERO, dvec3(0.3, 0.4, 0.0)]);
    assert!(close(two[0], 0.5) && close(two[1], 0.5), "{two:?}");
    let three = scales(vec![DVec3::ZERO, DVec3::X, dvec3(0.0, 1.0, 0.0)]);
    assert!(
        close(three[0], 1.0) && close(three[1], 1.5f64.sqrt()),
        "{three:?}"
    );
    // -0 is the same place as 0.
    for same in [vec![DVec3::ONE; 2], vec![DVec3::ZERO, -DVec3::ZERO]] {
        assert!(close(scales(same)[0], 1e-7f64.sqrt()));
    }
}

#[test]
fn many_points_at_one_place_start_small_and_cost_no_quadratic_time() {
    // Invalid pixels often all lie at the origin.
    let mut positions = vec![DVec3::ZERO; 100_000];
    positions.extend((0..1000).map(|i| {
        dvec3(
            f64::from(i % 10),
            f64::from(i / 10 % 10),
            f64::from(i / 100),
        ) * 0.1
            + 3.0
    }));
    let started = std::time::Instant::now();
    let scales = scales(positions);
    assert!(started.elapsed().as_secs() < 5, "{:?}", started.elapsed());
    assert!(scales[..100_000].iter().all(|s| close(*s, 1e-7f64.sqrt())));
    assert!(scales[100_000..].iter().all(|s| close(*s, 0.1)));
}

#[test]
fn gaussians_start_as_3dgs_does() {
    let mut points = cloud(vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]);
    points.colors = vec![[0, 51, 255], [255; 3], [0; 3], [128; 3]];
    let frame = Frame {
        center: dvec3(1.0, 2.0, 3.0),
        radius: 4.0,
        extent: 4.0,
    };
    let gaussians = Gaussians::from_cloud(&points, &frame, &paper().model).unwrap();
    assert_eq!(gaussians.len(), 4);
    assert_eq!(gaussians.means[0], Vec3::new(-0.25, -0.5, -0.75));
    // Three neighbours at 1, in a frame four times smaller.
    assert!(close(f64::from(gaussians.scales_log[0].x).exp(), 0.25));
    assert_eq!(gaussians.rotations_wxyz, [[1.0, 0.0, 0.0, 0.0]; 4]);
    let opacity = 1.0 / (1.0 + f64::from(-gaussians.opacity_logits[0]).exp());
    assert!((opacity - 0.1).abs() < 1e-7);
    assert_eq!(
        (gaussians.sh_degree, gaussians.n_sh(), gaussians.sh.len()),
        (3, 16, 4 * 48)
    );
    for (sh, rgb) in gaussians.sh.chunks(48).zip(&points.colors) {
        for (dc, value) in sh.iter().zip(rgb) {
            let color = 0.5 + 0.5 / std::f64::consts::PI.sqrt() * f64::from(*dc);
            assert!((color - f64::from(*value) / 255.0).abs() < 1e-7);
        }
        assert!(sh[3..].iter().all(|v| *v == 0.0));
    }
}

#[test]
fn gaussians_do_not_depend_on_the_number_of_threads() {
    let mut random = Random::new(3);
    let positions: Vec<DVec3> = (0..5000).map(|_| random.in_cube(1.0)).collect();
    let run = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n_threads)
            .build()
            .unwrap();
        pool.install(|| start(positions.clone()))
    };
    assert!(run(1) == run(3));
}

#[test]
fn what_cannot_become_gaussians_is_an_error() {
    let mut model = paper().model;
    let error = |points: &_, frame: &Frame, model: &_| {
        Gaussians::from_cloud(points, frame, model)
            .unwrap_err()
            .to_string()
    };
    assert!(error(&cloud(vec![]), &Frame::IDENTITY, &model).contains("no point"));
    let tiny = Frame {
        center: DVec3::ZERO,
        radius: 1e-60,
        extent: 1e-60,
    };
    let text = error(&cloud(vec![DVec3::ZERO, DVec3::X]), &tiny, &model);
    assert!(text.contains("cloud point 1"), "{text}");
    model.initial_opacity = 1.0;
    assert!(error(&cloud(vec![DVec3::X]), &Frame::IDENTITY, &model).contains("initial_opacity"));
    model.sh_degree = 4;
    assert!(error(&cloud(vec![DVec3::X]), &Frame::IDENTITY, &model).contains("sh_degree"));
}

/// Gaussians with every value different.
#[test]
fn gaussians_that_cannot_be_drawn_are_counted() {
    let mut gaussians = distinct(6, 0);
    assert_eq!(gaussians.n_broken(), 0);
    gaussians.means[0].y = f32::NAN;
    gaussians.scales_log[1].z = f32::INFINITY;
    gaussians.rotations_wxyz[2][3] = f32::NEG_INFINITY;
    gaussians.opacity_logits[3] = f32::NAN;
    assert_eq!(gaussians.n_broken(), 4);
}

/// Value by value as viewers read the format, from another model than the writer's.
#[test]
fn splat_files_hold_what_is_drawn_heaviest_first() {
    let gaussians = Gaussians {
        means: vec![Vec3::ONE, Vec3::new(1.0, -2.0, 3.5), Vec3::NAN],
        scales_log: vec![Vec3::splat(-3.0), Vec3::new(0.0, 1.0, -1.0), Vec3::ZERO],
        rotations_wxyz: vec![[2.0, 0.0, 0.0, 0.0], [-1.0, 1.0, -1.0, 1.0], [1.0; 4]],
        opacity_logits: vec![0.0, 2.0, 5.0],
        sh: [[9.0, 0.0, -9.0], [0.0, 0.5, -0.5], [0.0; 3]].concat(),
        sh_degree: 0,
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.splat");
    assert_eq!(write_splat(&path, &gaussians, &mut Vec::new()).unwrap(), 2);
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(bytes.len(), 64);
    let floats = |at: usize| -> Vec<f32> {
        let words = bytes[at..at + 24].chunks_exact(4);
        words
            .map(|word| f32::from_le_bytes(word.try_into().unwrap()))
            .collect()
    };
    let e = std::f32::consts::E;
    assert_eq!(floats(0)[..3], [1.0, -2.0, 3.5]);
    for (scale, expected) in floats(0)[3..].iter().zip([1.0, e, 1.0 / e]) {
        assert!((scale / expected - 1.0).abs() < 1e-6);
    }
    // 255 (0.5 + 0.28209 k) for k of 0 and +-0.5, and 255 / (1 + exp(-2)).
    assert_eq!(bytes[24..28], [128, 163, 92, 225]);
    // The same rotation with w of 0.5: 128 + 64, 128 - 64.
    assert_eq!(bytes[28..32], [192, 64, 192, 64]);
    assert_eq!(floats(32)[..3], [1.0; 3]);
    assert_eq!(bytes[56..64], [255, 128, 0, 128, 255, 128, 128, 128]);
}
