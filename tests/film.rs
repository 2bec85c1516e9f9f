//! Paths through cameras, and films along them, as another program reads them.

use glam::{DMat3, DVec3, dvec3};
use gspotential::camera::Camera;
use gspotential::camera::Frame;
use gspotential::camera::json::write_cameras;
use gspotential::camera::path::along;
use gspotential::gaussians::ply::write_ply;
use gspotential::report::{FilmTarget, write_film};
use gspotential::scene::Image;

use crate::gaussians_ply::distinct;
use crate::geometry::{camera, ring, scratch};
use crate::kit::program::{command, run, succeed};

#[test]
fn a_path_goes_through_its_cameras_at_an_even_pace_and_without_a_corner() {
    let focus = dvec3(10.0, -4.0, 2.0);
    let cameras = ring(5, focus);
    let path = along(&cameras, 401).unwrap();
    assert_eq!(path.len(), 401);
    // Steps are even here, so each camera is a hundred steps from the next.
    for (i, there) in cameras.iter().enumerate() {
        let here = &path[100 * i];
        let off = here.difference(there);
        assert!(off.shift < 1e-9 && off.turn < 1e-7, "{i}: {off:?}");
        assert!((here.fx - there.fx).abs() < 1e-9 && (here.cy - there.cy).abs() < 1e-9);
    }
    let steps: Vec<DVec3> = path
        .windows(2)
        .map(|w| w[1].center() - w[0].center())
        .collect();
    let lengths = || steps.iter().map(|step| step.length());
    let (least, most) = (
        lengths().fold(f64::MAX, f64::min),
        lengths().fold(0.0, f64::max),
    );
    assert!(most < 1.5 * least, "{least} {most}");
    for pair in steps.windows(2) {
        assert!(pair[0].angle_between(pair[1]) < 0.05, "a corner");
    }
    for camera in &path {
        let error = camera.rotation.transpose() * camera.rotation - DMat3::IDENTITY;
        assert!(error.to_cols_array().iter().all(|v| v.abs() < 1e-9));
        // Between cameras that look at one point, the path looks there, too, or nearly.
        let (_, depth) = camera.project(focus);
        assert!(depth > 0.0);
        let off = camera.forward().angle_between(focus - camera.center());
        assert!(off < 0.15, "{off}");
    }
}

#[test]
fn a_path_takes_other_sizes_to_the_first_one_and_skips_what_stands_still() {
    let mut cameras = ring(3, DVec3::ZERO);
    cameras.insert(1, cameras[0].clone());
    cameras[3] = cameras[3].resized(128, 96);
    let path = along(&cameras, 11).unwrap();
    let last = &path[10];
    assert_eq!((last.width, last.height), (64, 48));
    assert!((last.fx - 50.0).abs() < 1e-9 && (last.cx - 32.0).abs() < 1e-9);
    assert_eq!(last.name, "path_010");
    for none in [&cameras[..0], &cameras[..1], &cameras[..2]] {
        let error = along(none, 5).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains("--views"), "{error}");
    }
}

fn planes(film: &[u8]) -> Vec<[Vec<u8>; 3]> {
    let mut decoder = y4m::decode(film).expect("a film");
    assert!(matches!(
        decoder.get_colorspace(),
        y4m::Colorspace::C420jpeg
    ));
    assert!(decoder.get_raw_params().ends_with(b"XCOLORRANGE=LIMITED"));
    let mut frames = Vec::new();
    while let Ok(frame) = decoder.read_frame() {
        frames.push([
            frame.get_y_plane().to_vec(),
            frame.get_u_plane().to_vec(),
            frame.get_v_plane().to_vec(),
        ]);
    }
    frames
}

#[test]
fn a_film_has_the_colours_of_bt709_in_limited_range_and_even_sizes() {
    let (_folder, path) = scratch("film.y4m");
    // BT.709's primaries and greys in 8 bit, as its recommendation gives them.
    let known = [
        ([255, 255, 255], [235, 128, 128]),
        ([0, 0, 0], [16, 128, 128]),
        ([255, 0, 0], [63, 102, 240]),
        ([0, 255, 0], [173, 42, 26]),
        ([0, 0, 255], [32, 240, 118]),
    ];
    let target = FilmTarget::File(path.clone());
    write_film(&target, (5, 3), 5, |i| {
        Ok(Image {
            width: 5,
            height: 3,
            rgb: known[i as usize].0.repeat(15),
        })
    })
    .unwrap();
    let frames = planes(&std::fs::read(&path).unwrap());
    assert_eq!(frames.len(), 5);
    for ([y, u, v], (rgb, yuv)) in frames.iter().zip(known) {
        assert_eq!((y.len(), u.len(), v.len()), (4 * 2, 2, 2));
        assert_eq!([y[7], u[1], v[1]], yuv, "{rgb:?}");
    }
    let sizes = |i: u32| {
        Ok(Image {
            width: 5 + i,
            height: 3,
            rgb: vec![0; 3 * 3 * (5 + i as usize)],
        })
    };
    let error = write_film(&target, (5, 3), 2, sizes)
        .unwrap_err()
        .to_string();
    assert!(error.contains("6x3") && error.contains("--path"), "{error}");
    assert!(write_film(&target, (1, 3), 1, sizes).is_err());
}

#[test]
fn a_film_of_a_path_or_an_orbit_goes_to_stdout() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_cameras(&at("c.json"), &ring(3, DVec3::ZERO), DVec3::ZERO).unwrap();
    write_ply(&at("m.ply"), &distinct(20, 0), &Frame::IDENTITY).unwrap();
    let film = |rest: &str| {
        let line = format!("render --model m.ply --cameras c.json --y4m - {rest}");
        let output = command(folder.path(), &line).output().unwrap();
        let log = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{log}");
        planes(&output.stdout)
    };
    let path = film("--path 5");
    assert_eq!(path.len(), 5);
    assert_eq!(path[0][0].len(), 64 * 48);
    // It begins at the first view and ends at the last.
    let views = film("");
    assert_eq!(views.len(), 3);
    assert!(path[0] == views[0] && path[4] == views[2] && path[2] != views[0]);
    assert_eq!(film("--orbit 4").len(), 4);
    succeed(
        folder.path(),
        "render --model m.ply --cameras c.json --path 3 --out v",
    );
    assert!(at("v/path_002.png").is_file());
}

#[test]
fn paths_and_films_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let cameras = [camera(DVec3::X, DVec3::ZERO)];
    write_cameras(&at("one.json"), &cameras, DVec3::ZERO).unwrap();
    write_cameras(&at("none.json"), &[], DVec3::ZERO).unwrap();
    let named = |name: &str, eye: DVec3| Camera {
        name: name.to_owned(),
        ..camera(eye, DVec3::ZERO)
    };
    let two = [named("a", DVec3::X), named("b", DVec3::Y).resized(32, 24)];
    write_cameras(&at("two.json"), &two, DVec3::ZERO).unwrap();
    write_ply(&at("m.ply"), &distinct(20, 0), &Frame::IDENTITY).unwrap();
    for (rest, code, part) in [
        (
            "--cameras one.json --path 5 --out v",
            2,
            "two cameras that differ",
        ),
        ("--cameras none.json --path 5 --out v", 1, "no camera"),
        ("--cameras two.json --views a,c --path 5 --out v", 2, "`c`"),
        ("--cameras two.json --path 1 --out v", 2, "--path"),
        (
            "--cameras two.json --path 5 --orbit 5 --out v",
            2,
            "--orbit",
        ),
        ("--cameras two.json --path 5", 2, "--y4m"),
        ("--cameras two.json --out v --y4m f.y4m", 2, "--y4m"),
        ("--cameras two.json --y4m f.y4m --depth", 2, "--depth"),
        ("--cameras two.json --y4m f.y4m", 1, "32x24"),
        ("--cameras two.json --y4m none/f.y4m", 1, "none/f.y4m"),
    ] {
        let ended = run(folder.path(), &format!("render --model m.ply {rest}"));
        assert_eq!(ended.code, Some(code), "{rest}: {}", ended.log);
        assert!(ended.log.contains(part), "{rest}: {}", ended.log);
        assert!(!at("v").exists() && !at("f.y4m").exists(), "{rest}");
    }
}
