//! Cloud and cameras that belong together, and those that do not.

use glam::{DMat3, DVec3};
use gspotential::cloud::agreement::{Agreement, Verdict};
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::scene::{Scene, random_like};

fn builtin() -> Scene {
    scene(&BuiltinOptions {
        width: 160,
        n_test: 0,
        ..BuiltinOptions::default()
    })
}

/// The built-in scene, every point of its cloud moved.
fn moved(motion: impl Fn(DVec3) -> DVec3) -> Scene {
    let mut scene = builtin();
    for p in &mut scene.cloud.positions {
        *p = motion(*p);
    }
    scene
}

/// What is said of a scene, in one text.
fn said(scene: &Scene) -> String {
    match Agreement::of(scene) {
        Ok(agreement) => agreement.warnings.join("\n"),
        Err(error) => error.to_string(),
    }
}

#[track_caller]
fn says(scene: &Scene, parts: &[&str]) {
    let said = said(scene);
    for part in parts {
        assert!(said.contains(part), "{part:?} is not in {said:?}");
    }
}

#[test]
fn what_belongs_together_is_silent() {
    let scene = builtin();
    let agreement = Agreement::of(&scene).unwrap();
    assert_eq!(agreement.warnings, [""; 0]);
    let fits = agreement
        .views
        .iter()
        .filter(|v| v.verdict == Verdict::Fits);
    assert_eq!(fits.count(), scene.train.len());
    // Anywhere in the world, in any unit.
    let mut far = builtin();
    let offset = DVec3::new(500_000.0, 4_500_000.0, 120.0);
    far.cloud
        .positions
        .iter_mut()
        .for_each(|p| *p = *p * 1e3 + offset);
    for view in &mut far.train {
        let eye = view.camera.center() * 1e3 + offset;
        view.camera.translation = -(view.camera.rotation * eye);
    }
    assert_eq!(said(&far), "");
    // Random points claim no colour.
    let mut random = builtin();
    random.cloud = random_like(&random.cloud, 0);
    assert_eq!(said(&random), "");
    // Photographs of one colour tell nothing.
    let mut plain = builtin();
    plain
        .train
        .iter_mut()
        .for_each(|view| view.image.rgb.fill(99));
    assert_eq!(said(&plain), "");
    // Another exposure is no other scene.
    let mut dark = builtin();
    dark.train[1]
        .image
        .rgb
        .iter_mut()
        .for_each(|v| *v = *v / 2 + 10);
    assert_eq!(said(&dark), "");
}

#[test]
fn a_cloud_in_other_axes_or_another_unit_is_told_with_what_mends_it() {
    says(
        &moved(|p| p * DVec3::new(1.0, -1.0, -1.0)),
        &["belong together", "OpenGL"],
    );
    says(
        &moved(|p| p * 1000.0),
        &["belong together", "unit", "1.000e-3"],
    );
    says(
        &moved(|p| DVec3::new(p.y, p.z, p.x)),
        &["belong together", "other axes"],
    );
    let turn = DMat3::from_rotation_z(1.1) * DMat3::from_rotation_x(2.0);
    says(
        &moved(|p| turn * p * 3.7 + DVec3::splat(9.0)),
        &["belong together", "--cloud"],
    );
}

#[test]
fn a_view_that_alone_fits_nothing_is_named_with_the_cause() {
    let mut astray = builtin();
    astray.train[2].camera.translation += DVec3::new(4e5, 1e5, -2e5);
    says(
        &astray,
        &["`train_02.png` sees nothing", "3 others fit", "astray"],
    );
    let mut turned = builtin();
    let pixels: Vec<[u8; 3]> = turned.train[1]
        .image
        .rgb
        .chunks_exact(3)
        .map(|p| [p[0], p[1], p[2]])
        .collect();
    turned.train[1].image.rgb = pixels.into_iter().rev().flatten().collect();
    says(
        &turned,
        &[
            "`train_01.png` fits the cloud no better",
            "turned by 180 degrees",
        ],
    );
}

#[test]
fn what_agrees_by_more_than_chance_but_would_clearly_better_is_told() {
    let mut swapped = builtin();
    swapped.cloud.colors.iter_mut().for_each(|c| c.reverse());
    says(&swapped, &["red and blue", "exchanged"]);
    let mut mirrored = builtin();
    for view in &mut mirrored.train {
        let width = 3 * view.image.width as usize;
        for row in view.image.rgb.chunks_exact_mut(width) {
            let pixels: Vec<[u8; 3]> = row.as_chunks().0.iter().rev().copied().collect();
            row.copy_from_slice(pixels.as_flattened());
        }
    }
    says(&mirrored, &["mirrored"]);
}

#[test]
fn a_few_points_are_told_to_be_few() {
    let mut few = builtin();
    few.cloud = gspotential::scene::thin(&few.cloud, 5, 0);
    says(&few, &["only 5 points"]);
}

#[test]
fn a_cloud_that_no_view_sees_is_refused() {
    let behind = moved(|p| p + DVec3::splat(1e6));
    assert!(
        Agreement::of(&behind)
            .unwrap_err()
            .to_string()
            .contains("none of the 4 training views")
    );
}
