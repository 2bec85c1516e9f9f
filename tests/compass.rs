//! Directions about the focus as angles.

use glam::DVec3;
use gspotential::camera::Camera;
use gspotential::camera::compass::Compass;

#[test]
fn angles_and_directions_invert_one_another() {
    let compass = Compass::new(DVec3::new(0.3, -0.8, 0.2), DVec3::new(1.0, 0.4, -2.0)).unwrap();
    for azimuth in [-179.0, -90.0, -0.5, 0.0, 33.0, 180.0] {
        for elevation in [-89.0, -20.0, 0.0, 61.0] {
            let direction = compass.direction(azimuth, elevation);
            assert!((direction.length() - 1.0).abs() < 1e-12);
            let back = compass.angles(direction);
            // 180 and -180 are one azimuth.
            let turn = (back.0 - azimuth + 180.0).rem_euclid(360.0) - 180.0;
            assert!(
                turn.abs() < 1e-9 && (back.1 - elevation).abs() < 1e-9,
                "{back:?}"
            );
        }
    }
}

/// Seen from a camera at the front, a greater azimuth lies to the right in the image.
#[test]
fn azimuth_grows_to_the_right_of_who_looks_at_the_focus() {
    let (focus, up) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.1, -1.0, 0.2));
    let eye = focus + DVec3::new(2.0, -0.4, 1.0);
    let any = Camera {
        name: "a".to_owned(),
        width: 100,
        height: 100,
        fx: 100.0,
        fy: 100.0,
        cx: 50.0,
        cy: 50.0,
        rotation: glam::DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    let camera = any.looking_at("a".to_owned(), eye, focus, up);
    let compass = Compass::of_cameras(std::slice::from_ref(&camera), focus).unwrap();
    let (azimuth, elevation) = compass.angles((eye - focus).normalize());
    assert!(azimuth.abs() < 1e-9, "{azimuth}");
    let place = |azimuth: f64, elevation: f64| {
        camera.rotation * (focus + compass.direction(azimuth, elevation)) + camera.translation
    };
    let ahead = place(0.0, elevation);
    assert!(place(20.0, elevation).x > ahead.x + 0.1);
    // y is down.
    assert!(place(0.0, elevation + 20.0).y < ahead.y - 0.1);
    assert!(Compass::of_cameras(&[], focus).is_err());
}

#[test]
fn a_front_overhead_is_no_front() {
    let compass = Compass::new(DVec3::Z, DVec3::Z).unwrap();
    assert!(compass.direction(0.0, 0.0).z.abs() < 1e-12);
    assert!(Compass::new(DVec3::ZERO, DVec3::X).is_err());
}

#[test]
fn the_grid_runs_from_the_zenith_down_and_from_the_back_to_the_right() {
    let compass = Compass::new(DVec3::Y, DVec3::X).unwrap();
    let grid = compass.grid(9);
    assert_eq!(grid.len(), 9 * 18);
    let (azimuth, elevation) = compass.angles(grid[0]);
    assert!((azimuth + 170.0).abs() < 1e-9 && (elevation - 80.0).abs() < 1e-9);
    let (azimuth, elevation) = compass.angles(grid[9 * 18 - 1]);
    assert!((azimuth - 170.0).abs() < 1e-9 && (elevation + 80.0).abs() < 1e-9);
}
