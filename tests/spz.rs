//! .spz files, as another program reads them.

use std::process::Command;

use glam::{DVec3, Vec3, dvec3};
use gspotential::camera::Frame;
use gspotential::doctor::twin::sh::basis;
use gspotential::gaussians::Gaussians;
use gspotential::gaussians::ply::{Stored, read_ply, write_ply};
use gspotential::gaussians::spz::write_spz;
use spz_rs::UnpackedGaussian;

use crate::gaussians_ply::distinct;
use crate::geometry::{Random, scratch};

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

/// What another program reads, and what was told.
fn exported(gaussians: &Gaussians) -> (Vec<UnpackedGaussian>, String) {
    let (_folder, path) = scratch("scene.spz");
    let mut warnings = Vec::new();
    let n = write_spz(&path, gaussians, &mut warnings).unwrap();
    let read = spz_rs::load_packed_gaussians_from_file(&path.to_str().unwrap().to_owned()).unwrap();
    assert_eq!(read.num_points, n);
    (
        (0..n).map(|i| read.unpack(i)).collect(),
        warnings.join("\n"),
    )
}

/// Opaque spheres of scale 0.01 in a cube of side 2, times `unit` and about `center`.
fn spheres(n: usize, unit: f32, center: DVec3) -> Gaussians {
    let mut random = Random::new(1);
    let mut place = || (random.in_cube(1.0) * f64::from(unit) + center).as_vec3();
    Gaussians {
        means: (0..n).map(|_| place()).collect(),
        scales_log: vec![Vec3::splat((0.01 * unit).ln()); n],
        rotations_wxyz: vec![[1.0, 0.0, 0.0, 0.0]; n],
        opacity_logits: vec![2.0; n],
        sh: vec![0.5; 3 * n],
        sh_degree: 0,
    }
}

/// The largest difference of a position, in the scene's unit, and of a scale's logarithm: times `factor`
/// and with `origin` taken out. Equal Gaussians keep their order.
fn differences(
    there: &[UnpackedGaussian],
    gaussians: &Gaussians,
    factor: f64,
    origin: DVec3,
) -> (f64, f64) {
    assert_eq!(there.len(), gaussians.len());
    let (mut place, mut size) = (0.0_f64, 0.0_f64);
    for (there, (mean, scale)) in there
        .iter()
        .zip(gaussians.means.iter().zip(&gaussians.scales_log))
    {
        let [x, y, z] = there.position.map(f64::from);
        let back = dvec3(x, -y, -z) / factor + origin;
        place = place.max(back.distance(mean.as_dvec3()));
        let log = f64::from(there.scale[0]) - factor.ln();
        size = size.max((log - f64::from(scale.x)).abs());
    }
    (place, size)
}

/// The numbers behind `before` in what was told.
fn numbers(said: &str, before: &str) -> Vec<f64> {
    let at = said
        .find(before)
        .unwrap_or_else(|| panic!("no {before:?} in {said:?}"));
    let words = said[at + before.len()..].split([' ', ',']);
    words.map_while(|word| word.parse().ok()).collect()
}

#[test]
fn a_scene_whose_numbers_fit_a_spz_file_is_stored_as_it_is_silently() {
    for unit in [0.1, 1.0, 1000.0] {
        let gaussians = spheres(500, unit, DVec3::ZERO);
        let (there, said) = exported(&gaussians);
        assert_eq!(said, "");
        let (place, size) = differences(&there, &gaussians, 1.0, DVec3::ZERO);
        // Steps are 2^-20 or, where that would not reach, 2^-23 of the farthest.
        assert!(place <= 1e-6 * f64::from(unit).max(1.0), "{unit}: {place}");
        assert!(size <= 1.0 / 32.0 + 1e-4, "{unit}: {size}");
    }
}

#[test]
fn a_scene_in_a_huge_or_tiny_unit_is_scaled_to_fit_a_spz_file_and_the_factor_told() {
    for unit in [1e-4, 1e5, 1e9, 1e30, 1e-30] {
        let gaussians = spheres(500, unit, DVec3::ZERO);
        let (there, said) = exported(&gaussians);
        let factor = numbers(&said, "multiplied by ")[0];
        assert_eq!(said.lines().count(), 1, "{said}");
        let (place, size) = differences(&there, &gaussians, factor, DVec3::ZERO);
        // A fiftieth of what a Gaussian measures.
        assert!(place <= 2e-4 * f64::from(unit), "{unit}: {place}");
        assert!(size <= 1.0 / 32.0 + 1e-4, "{unit}: {size}");
    }
}

#[test]
fn a_scene_in_utm_makes_the_round_trip_through_ply_and_spz() {
    let local = spheres(500, 0.02, DVec3::ZERO);
    let frame = Frame {
        center: dvec3(500_123.25, 5_400_321.5, 312.0),
        radius: 40.0,
        extent: 40.0,
    };
    let (_folder, path) = scratch("point_cloud.ply");
    write_ply(&path, &local, &frame).unwrap();
    let Stored { gaussians, offset } = read_ply(&path).unwrap();
    let (there, said) = exported(&gaussians);
    assert_eq!(said, "");
    for (there, mean) in there.iter().zip(&local.means) {
        let [x, y, z] = there.position.map(f64::from);
        let world = dvec3(x, -y, -z) + offset;
        let was = frame.to_world(mean.as_dvec3());
        assert!(world.distance(was) <= 1e-5, "{world} {was}");
    }
    // Another program's model has them there as they are, on f32's grid of half a unit.
    let there_as_it_is = spheres(500, 40.0, frame.center);
    let (there, said) = exported(&there_as_it_is);
    let origin = DVec3::from_slice(&numbers(&said, "positions are without "));
    let (place, size) = differences(&there, &there_as_it_is, 1.0, origin);
    assert!(place <= 1e-4 && size <= 1.0 / 32.0 + 1e-4, "{place} {size}");
}

#[test]
fn a_few_gaussians_far_away_do_not_make_a_spz_file_coarse() {
    let mut gaussians = spheres(5000, 1.0, DVec3::ZERO);
    gaussians.means[7] = Vec3::new(0.0, -3e6, 0.0);
    gaussians.means[8].x = 1e9;
    let (there, said) = exported(&gaussians);
    assert_eq!(numbers(&said, ""), [2.0], "{said}");
    assert!(said.contains("are left out"), "{said}");
    assert_eq!(there.len(), 4998);
    // If everything is far from everything else, all stay, and what is lost is told.
    let mut sparse = spheres(500, 1.0, DVec3::ZERO);
    sparse.means.iter_mut().for_each(|m| *m *= 1e8);
    let (there, said) = exported(&sparse);
    assert_eq!(there.len(), 500);
    assert!(
        said.contains("100.0 % of the Gaussians are smaller than the steps"),
        "{said}"
    );
}

#[test]
fn flat_gaussians_go_into_a_spz_file_and_what_is_cut_off_is_told() {
    let mut flat = spheres(400, 1.0, DVec3::ZERO);
    flat.scales_log
        .iter_mut()
        .for_each(|s| s.z = f32::NEG_INFINITY);
    let (there, said) = exported(&flat);
    assert_eq!(said, "");
    assert!(
        there
            .iter()
            .all(|g| g.scale[2] == -10.0 && g.scale[0] > -5.0)
    );
    // Sizes of half an order beyond what a byte holds, too few for the scene to be scaled.
    let mut mixed = spheres(400, 1.0, DVec3::ZERO);
    mixed.scales_log[3] = Vec3::splat(5.9375 + 2.0_f32.ln());
    let (_, said) = exported(&mixed);
    assert!(
        said.contains("sizes of 0.25 % of the Gaussians are cut off, by up to 50"),
        "{said}"
    );
    let mut bright = spheres(400, 1.0, DVec3::ZERO);
    bright.sh[4] = 0.5 / 0.15 + 1.0;
    bright.sh[9] = -9.0;
    let (_, said) = exported(&bright);
    // 0.28209 (9 - 3.3333).
    assert!(
        said.contains("colours of 0.50 % of the Gaussians are cut off, by up to 1.60"),
        "{said}"
    );
    let mut shiny = distinct(40, 1);
    shiny.sh.iter_mut().for_each(|c| *c = c.clamp(-1.0, 0.99));
    assert_eq!(exported(&shiny).1, "");
    shiny.sh[10 * 12 + 4] = -2.5;
    let (_, said) = exported(&shiny);
    assert!(
        said.contains(
            "view-dependent colour of 2.50 % of the Gaussians are cut off, by up to 1.50"
        ),
        "{said}"
    );
}

#[test]
fn an_export_of_what_is_never_drawn_fails_and_leaves_no_file() {
    let (folder, path) = scratch("point_cloud.ply");
    let mut unseen = spheres(3, 1.0, DVec3::ZERO);
    unseen.opacity_logits.fill(-20.0);
    let none = spheres(0, 1.0, DVec3::ZERO);
    for (gaussians, said) in [
        (unseen, "none of the 3 Gaussians is ever drawn"),
        (none, "0 Gaussians"),
    ] {
        write_ply(&path, &gaussians, &Frame::IDENTITY).unwrap();
        for name in ["out.spz", "out.splat"] {
            let output = Command::new(env!("CARGO_BIN_EXE_gspotential"))
                .args(["export", "point_cloud.ply", "--out", name])
                .current_dir(folder.path())
                .output()
                .expect("the program");
            let error = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(1), "{error}");
            assert!(
                error.contains(said) && error.contains("point_cloud.ply"),
                "{error}"
            );
            assert!(!folder.path().join(name).exists());
        }
    }
}

#[track_caller]
fn within(a: &[f32], b: &[f32], tolerance: f32) {
    let is_close = a
        .iter()
        .zip(b)
        .all(|(a, b)| (a - b).abs() <= 1.001 * tolerance);
    assert!(a.len() == b.len() && is_close, "{a:?} {b:?}");
}
