//! Cameras at the size that DUSt3R, MASt3R and VGGT see photographs at.

use gspotential::camera::Camera;
use gspotential::scene::Scene;

use super::build::{Folder, GOOD_PLY, images_txt, png};

/// A scene of one photograph of `photograph` pixels and a camera of another size.
fn folder(photograph: (u32, u32), size: (u32, u32), params: [f64; 4]) -> Folder {
    let folder = Folder::empty();
    let params = params.map(|v| v.to_string()).join(" ");
    let camera = format!("1 PINHOLE {} {} {params}\n", size.0, size.1);
    folder.write("sparse/0/cameras.txt", camera);
    folder.write("sparse/0/images.txt", images_txt(&["a.png"]));
    folder.write("sparse/0/points3D.ply", GOOD_PLY);
    folder.write("images/a.png", png(photograph.0, photograph.1));
    folder
}

fn lens(scene: &Scene) -> [f64; 4] {
    let Camera { fx, fy, cx, cy, .. } = scene.train[0].camera;
    [fx, fy, cx, cy]
}

/// A photograph's size, the size that it is scaled to, what is cut off its left and top there
/// (negative where it is padded), what is left, and who does that.
type Sight = ((u32, u32), [f64; 2], [f64; 2], (u32, u32), &'static str);

/// By hand from `dust3r/utils/image.py` and `vggt/utils/load_fn.py`.
const SIGHTS: [Sight; 10] = [
    // 54 * 512 / 81 = 341.3; 341 // 2 = 170, of which 168 are kept.
    ((81, 54), [512.0, 341.0], [0.0, 2.0], (512, 336), "DUSt3R"),
    ((54, 81), [341.0, 512.0], [2.0, 0.0], (336, 512), "DUSt3R"),
    // An odd height: the last row goes.
    ((100, 63), [512.0, 323.0], [0.0, 1.0], (512, 320), "DUSt3R"),
    // Squares become 4:3.
    ((60, 60), [512.0, 512.0], [0.0, 64.0], (512, 384), "DUSt3R"),
    // Its small models see the middle square.
    ((90, 60), [336.0, 224.0], [56.0, 0.0], (224, 224), "DUSt3R"),
    // 48 * 518 / 64 / 14 = 27.75.
    ((64, 48), [518.0, 392.0], [0.0, 0.0], (518, 392), "VGGT"),
    ((240, 160), [518.0, 350.0], [0.0, 0.0], (518, 350), "VGGT"),
    // 64 * 518 / 48 / 14 = 49.3: 686 rows, of which the middle 518 are kept.
    ((48, 64), [518.0, 686.0], [0.0, 84.0], (518, 518), "VGGT"),
    // Padded to a square of 60 before it is scaled by 518 / 60.
    (
        (60, 40),
        [518.0, 518.0 / 1.5],
        [0.0, -518.0 / 6.0],
        (518, 518),
        "VGGT",
    ),
    // Scaled to 350 rows and then padded by 84.
    ((60, 40), [518.0, 350.0], [0.0, -84.0], (518, 518), "VGGT"),
];

#[test]
fn cameras_of_what_networks_see_are_mapped_to_the_whole_photograph() {
    let whole = [50.0, 50.0, 31.0, 22.0];
    for (photograph, scaled, corner, size, program) in SIGHTS {
        let scale = [
            scaled[0] / f64::from(photograph.0),
            scaled[1] / f64::from(photograph.1),
        ];
        let seen = [
            whole[0] * scale[0],
            whole[1] * scale[1],
            whole[2] * scale[0] - corner[0],
            whole[3] * scale[1] - corner[1],
        ];
        let scene = folder(photograph, size, seen).scene();
        let found = lens(&scene);
        let near = |(a, b): (&f64, f64)| (a - b).abs() < 1e-9;
        assert!(
            found.iter().zip(whole).all(near),
            "{photograph:?} seen as {size:?}: {found:?}"
        );
        let warning = &scene.warnings[1];
        let expected = format!("1 cameras are of what {program} sees of a photograph");
        assert!(warning.starts_with(&expected), "{warning}");
        // Half a pixel off is not what was written.
        let mut off = seen;
        off[3] += 0.5 * scale[1];
        let found = lens(&folder(photograph, size, off).scene());
        assert!((found[3] - 22.5).abs() < 1e-9, "{found:?}");
    }
}

#[test]
fn other_crops_stay_refused() {
    for (photograph, size) in [
        ((81, 54), (512, 320)),
        ((81, 54), (512, 352)),
        ((81, 54), (518, 336)),
        ((64, 48), (518, 406)),
        ((60, 40), (504, 504)),
        ((60, 40), (224, 160)),
    ] {
        let params = [500.0, 500.0, 256.0, 168.0];
        folder(photograph, size, params).fails_with(&["images/a.png", "use the images that"]);
    }
    folder((54, 81), (512, 336), [500.0, 500.0, 256.0, 168.0]).fails_with(&["stored sideways"]);
}

#[test]
fn a_size_that_is_the_photographs_shape_is_only_scaled() {
    // DUSt3R of a square where squares are allowed, and any other program.
    let scene = folder((60, 60), (512, 512), [512.0, 512.0, 256.0, 256.0]).scene();
    assert_eq!(lens(&scene), [60.0, 60.0, 30.0, 30.0]);
    assert!(scene.warnings[1].contains("intrinsics rescaled"));
}
