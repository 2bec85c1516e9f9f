//! The Gaussians that training starts from.

use glam::{DVec3, Vec3, dvec3};
use gspotential::camera::Frame;
use gspotential::config::ModelConfig;
use gspotential::doctor::twin::sh::basis;
use gspotential::gaussians::Gaussians;
use gspotential::gaussians::splat::write_splat;
use gspotential::gaussians::spz::write_spz;
use gspotential::scene::PointCloud;

use crate::gaussians_ply::distinct;
use crate::geometry::{Random, cloud, paper, scratch};

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

#[test]
fn opacities_follow_the_confidence_where_asked() {
    let n = 9;
    let mut points = cloud((0..n).map(|i| dvec3(f64::from(i), 0.0, 0.0)).collect());
    let mut config = paper().model;
    let opacities = |points: &PointCloud, config: &ModelConfig| -> Vec<f64> {
        let start = Gaussians::from_cloud(points, &Frame::IDENTITY, config).unwrap();
        let opacity = |l: &f32| 1.0 / (1.0 + f64::from(-l).exp());
        start.opacity_logits.iter().map(opacity).collect()
    };
    let plain = opacities(&points, &config);
    assert!(plain.iter().all(|o| close(*o, 0.1)));
    // The median is 4: confidences count up to there, and 0 is held above nothing.
    points.confidence = Some((0..n).map(|i| i as f32).collect());
    assert_eq!(opacities(&points, &config), plain);
    config.confidence_opacity = true;
    let expected = [0.001, 0.025, 0.05, 0.075, 0.1, 0.1, 0.1, 0.1, 0.1];
    let weighted = opacities(&points, &config);
    assert!(
        weighted.iter().zip(expected).all(|(a, b)| close(*a, b)),
        "{weighted:?}"
    );
    // In another unit they say the same.
    points.confidence = Some((0..n).map(|i| 1e-3 * i as f32).collect());
    assert!(
        opacities(&points, &config)
            .iter()
            .zip(expected)
            .all(|(a, b)| close(*a, b))
    );
    // Mostly 0, others count fully.
    points.confidence = Some((0..n).map(|i| if i > 6 { 0.5 } else { 0.0 }).collect());
    let masked = opacities(&points, &config);
    assert!(
        close(masked[0], 0.001) && close(masked[8], 0.1),
        "{masked:?}"
    );
    points.confidence = None;
    assert_eq!(opacities(&points, &config), plain);
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

/// What another program reads of a .spz file is the scene, turned about the x axis by half a turn.
#[test]
fn spz_files_hold_the_scene_within_a_step_of_each_value() {
    let (_folder, path) = scratch("scene.spz");
    let name = path.to_str().unwrap().to_owned();
    for sh_degree in 0..=3 {
        let mut gaussians = distinct(40, sh_degree);
        // Coefficients reach from -1 to 1.
        gaussians.sh.iter_mut().for_each(|c| *c *= 0.3);
        gaussians.opacity_logits[7] = -20.0;
        assert_eq!(write_spz(&path, &gaussians, &mut Vec::new()).unwrap(), 39);
        let read = spz_rs::load_packed_gaussians_from_file(&name).unwrap();
        assert_eq!((read.num_points, read.sh_degree), (39, sh_degree as usize));
        for (k, i) in gaussians.heaviest(40).into_iter().enumerate() {
            let there = read.unpack(k);
            let [x, y, z] = gaussians.means[i].to_array();
            within(&there.position, &[x, -y, -z], 1e-6);
            within(
                &there.scale,
                &gaussians.scales_log[i].to_array(),
                1.0 / 32.0,
            );
            let [w, x, y, z] = gaussians.rotation(i).unwrap();
            // The reader finds w from the others, which are rounded.
            within(&there.rotation[1..], &[x, -y, -z], 1.0 / 255.0);
            within(&there.rotation[..1], &[w], 0.12);
            let opacity = 1.0 / (1.0 + (-there.alpha).exp());
            within(&[opacity], &[gaussians.opacity(i)], 0.5 / 255.0);
            let n_sh = gaussians.n_sh();
            let sh = |k: usize, c: usize| gaussians.sh[(i * n_sh + k) * 3 + c];
            within(
                &there.color,
                &[sh(0, 0), sh(0, 1), sh(0, 2)],
                0.5 / 255.0 / 0.15,
            );
            // The colour seen along any direction is the same in either frame.
            for direction in [
                dvec3(0.6, 0.0, 0.8),
                dvec3(-0.48, 0.6, 0.64),
                dvec3(0.36, -0.8, 0.48),
            ] {
                let turned = direction * dvec3(1.0, -1.0, -1.0);
                let (here, seen) = (basis(direction.to_array()), basis(turned.to_array()));
                for (c, rest) in [there.sh_r, there.sh_g, there.sh_b].iter().enumerate() {
                    let ours: f64 = (1..n_sh).map(|k| here[k] * f64::from(sh(k, c))).sum();
                    let theirs: f64 = (1..n_sh).map(|k| seen[k] * f64::from(rest[k - 1])).sum();
                    // Half a step of each coefficient, 4/128 for degree 1 and 8/128 beyond.
                    let step = |k: usize| if k < 4 { 4.5 / 128.0 } else { 8.5 / 128.0 };
                    let bound: f64 = (1..n_sh).map(|k| here[k].abs() * step(k)).sum();
                    assert!(
                        (ours - theirs).abs() <= bound,
                        "degree {sh_degree}: {ours} {theirs}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_spz_file_reaches_as_far_as_its_numbers_and_no_farther() {
    let (_folder, path) = scratch("scene.spz");
    let mut gaussians = distinct(3, 1);
    gaussians.sh.fill(0.0);
    // Red of the first coefficient of degree 1, whose sign changes: beyond what 32 bits count.
    gaussians.sh[3] = -1e30;
    gaussians.means[1] = Vec3::new(0.0, -8_000_000.0, 5.0);
    assert_eq!(write_spz(&path, &gaussians, &mut Vec::new()).unwrap(), 3);
    let read = spz_rs::load_packed_gaussians_from_file(&path.to_str().unwrap().to_owned()).unwrap();
    let farthest = (0..3)
        .map(|k| read.unpack(k).position[1])
        .fold(0.0, f32::max);
    assert_eq!(farthest, 8_000_000.0);
    let reds = (0..3).map(|k| read.unpack(k).sh_r[0]);
    assert_eq!(reds.fold(0.0, f32::max), 127.0 / 128.0);
    gaussians.means[1].y = -9_000_000.0;
    let error = write_spz(&path, &gaussians, &mut Vec::new())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("9000000") && error.contains("scene.spz"),
        "{error}"
    );
}

#[track_caller]
fn within(a: &[f32], b: &[f32], tolerance: f32) {
    let is_close = a
        .iter()
        .zip(b)
        .all(|(a, b)| (a - b).abs() <= 1.001 * tolerance);
    assert!(a.len() == b.len() && is_close, "{a:?} {b:?}");
}
