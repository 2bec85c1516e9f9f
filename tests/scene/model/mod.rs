//! COLMAP models: poses and intrinsics.

mod damaged;
mod intrinsics;
mod reading;

use crate::scene::build::{
    CAMERAS_TXT, Folder, GOOD_PLY, SIZE, fails_with, images_txt, options, png, warns,
};
use glam::{DMat3, DQuat, DVec3};
use gspotential::error::ErrorKind;
use gspotential::scene::{Scene, SceneSource, load};

/// id, model, model id, parameters
type CameraLine = (i32, &'static str, i32, Vec<f64>);

/// rotation wxyz, translation, camera id, name, number of observations
type ImageLine = ([f64; 4], [f64; 3], i32, Vec<u8>, u64);

/// A model to write in either encoding.
struct Model {
    cameras: Vec<CameraLine>,
    images: Vec<ImageLine>,
}

impl Model {
    fn cameras_txt(&self) -> String {
        let line = |(id, model, _, params): &CameraLine| {
            let params: Vec<String> = params.iter().map(f64::to_string).collect();
            format!("{id} {model} {} {} {}\n", SIZE.0, SIZE.1, params.join(" "))
        };
        self.cameras.iter().map(line).collect()
    }

    fn images_txt(&self) -> Vec<u8> {
        let mut bytes = b"# images\n".to_vec();
        for (i, ([w, x, y, z], [tx, ty, tz], camera, name, n)) in self.images.iter().enumerate() {
            bytes.extend(format!("{i} {w} {x} {y} {z} {tx} {ty} {tz} {camera} ").bytes());
            bytes.extend(name);
            bytes.extend(format!("\n{}\n", "1.5 2.5 -1 ".repeat(*n as usize)).bytes());
        }
        bytes
    }

    fn cameras_bin(&self) -> Vec<u8> {
        let mut bytes = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for (id, _, model, params) in &self.cameras {
            bytes.extend(id.to_le_bytes());
            bytes.extend(model.to_le_bytes());
            bytes.extend(u64::from(SIZE.0).to_le_bytes());
            bytes.extend(u64::from(SIZE.1).to_le_bytes());
            bytes.extend(params.iter().flat_map(|p| p.to_le_bytes()));
        }
        bytes
    }

    fn images_bin(&self) -> Vec<u8> {
        let mut bytes = (self.images.len() as u64).to_le_bytes().to_vec();
        for (i, (rotation, translation, camera, name, n)) in self.images.iter().enumerate() {
            bytes.extend((i as i32).to_le_bytes());
            bytes.extend(
                rotation
                    .iter()
                    .chain(translation)
                    .flat_map(|v| v.to_le_bytes()),
            );
            bytes.extend(camera.to_le_bytes());
            bytes.extend(name);
            bytes.push(0);
            bytes.extend(n.to_le_bytes());
            bytes.resize(bytes.len() + 24 * *n as usize, 0xee);
        }
        bytes
    }

    fn folder(&self, place: &str, binary: bool) -> Folder {
        let folder = Folder::empty();
        if binary {
            folder.write(&format!("{place}/cameras.bin"), self.cameras_bin());
            folder.write(&format!("{place}/images.bin"), self.images_bin());
        } else {
            folder.write(&format!("{place}/cameras.txt"), self.cameras_txt());
            folder.write(&format!("{place}/images.txt"), self.images_txt());
        }
        folder.write(&format!("{place}/points3D.ply"), GOOD_PLY);
        for (_, _, _, name, _) in &self.images {
            if let Ok(name) = std::str::from_utf8(name)
                && !name.is_empty()
                && !name.contains("..")
                && !name.starts_with('/')
            {
                folder.write(&format!("images/{name}"), png(SIZE.0, SIZE.1));
            }
        }
        folder
    }

    #[track_caller]
    fn fails_with(&self, text_place: &str, binary_place: &str, parts: &[&str]) {
        for (binary, place) in [(false, text_place), (true, binary_place)] {
            let mut parts = parts.to_vec();
            parts.push(place);
            self.folder("sparse/0", binary).fails_with(&parts);
        }
    }
}

/// PINHOLE and `SIMPLE_PINHOLE`, shared and not, unsorted, a name with a blank and a folder.
fn good() -> Model {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1);
    let pose = |i: f64| {
        let q = DQuat::from_rotation_y(0.4 * i) * turn;
        ([q.w, q.x, q.y, q.z], [0.1 * i, -0.2, 3.0 + i])
    };
    let image = |i: u8, camera, name: &str| {
        let (rotation, translation) = pose(f64::from(i));
        (
            rotation,
            translation,
            camera,
            name.as_bytes().to_vec(),
            u64::from(i % 3),
        )
    };
    Model {
        cameras: vec![
            (4, "PINHOLE", 1, vec![10.25, 11.5, 6.125, 3.875]),
            (-9, "SIMPLE_PINHOLE", 0, vec![12.0, 6.0, 4.0]),
        ],
        images: vec![
            image(1, 4, "c.png"),
            image(2, -9, "left/a b.png"),
            image(0, 4, "d.png"),
            image(3, -9, "b.png"),
            image(4, 4, "e.png"),
        ],
    }
}

#[track_caller]
fn check_good(scene: &Scene, model: &Model) {
    warns(scene, &[]);
    let names: Vec<_> = scene.train.iter().map(|v| v.camera.name.as_str()).collect();
    assert_eq!(names, ["b.png", "c.png", "e.png", "left/a b.png"]);
    assert_eq!(scene.test.len(), 1);
    for view in scene.train.iter().chain(&scene.test) {
        let camera = &view.camera;
        let ([w, x, y, z], t, id, ..) = model
            .images
            .iter()
            .find(|image| image.3 == camera.name.as_bytes())
            .expect("the image of that name");
        let rotation = DMat3::from_quat(DQuat::from_xyzw(*x, *y, *z, *w));
        assert!(
            camera.rotation.abs_diff_eq(rotation, 1e-14),
            "{}",
            camera.name
        );
        assert_eq!(camera.translation, DVec3::from(*t));
        let got = [camera.fx, camera.fy, camera.cx, camera.cy];
        let expected = if *id == 4 {
            [10.25, 11.5, 6.125, 3.875]
        } else {
            [12.0, 12.0, 6.0, 4.0]
        };
        assert_eq!(got, expected, "{}", camera.name);
        assert_eq!((camera.width, camera.height), SIZE);
    }
}
