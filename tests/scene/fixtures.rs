//! The built-in scene, tiny, written in each format that is read: by the formats' definitions,
//! not by the crate's own code.

use glam::{DMat3, DQuat, DVec2, DVec3};
use gspotential::camera::Camera;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::scene::{PointCloud, Scene, View};
use serde_json::{Value, json};

use super::build::Folder;

/// Width of the images, pixels.
pub(crate) const WIDTH: u32 = 32;

/// 4 training and 2 test views, and a cloud with confidences.
pub(crate) fn still_life() -> Scene {
    scene(&BuiltinOptions {
        width: WIDTH,
        n_test: 2,
        pixel_step: 2,
        ..BuiltinOptions::default()
    })
}

/// The camera's axes of `transforms.json`, of which ours are multiplied by these.
pub(crate) const OPENGL: [f64; 3] = [1.0, -1.0, -1.0];

pub(crate) fn names(views: &[View]) -> Vec<&str> {
    views.iter().map(|v| v.camera.name.as_str()).collect()
}

/// The pixel that a point falls on.
pub(crate) fn project(camera: &Camera, p: DVec3) -> DVec2 {
    let p = camera.rotation * p + camera.translation;
    DVec2::new(
        camera.fx * p.x / p.z + camera.cx,
        camera.fy * p.y / p.z + camera.cy,
    )
}

pub(crate) fn views(scene: &Scene) -> impl Iterator<Item = &View> {
    scene.train.iter().chain(&scene.test)
}

pub(crate) fn write_images<'a>(folder: &Folder, dir: &str, views: impl Iterator<Item = &'a View>) {
    for view in views {
        let image =
            image::RgbImage::from_raw(view.image.width, view.image.height, view.image.rgb.clone())
                .expect("a buffer of the image's size");
        let mut bytes = std::io::Cursor::new(Vec::new());
        image
            .write_to(&mut bytes, image::ImageFormat::Png)
            .expect("a PNG");
        folder.write(&format!("{dir}/{}", view.camera.name), bytes.into_inner());
    }
}

/// Binary, as trimesh and plyfile write clouds: float positions, uchar colours.
pub(crate) fn ply(cloud: &PointCloud, with_alpha: bool) -> Vec<u8> {
    let alpha = if with_alpha {
        "property uchar alpha\n"
    } else {
        ""
    };
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n\
         property float y\nproperty float z\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\n{alpha}end_header\n",
        cloud.len()
    )
    .into_bytes();
    for (position, color) in cloud.positions.iter().zip(&cloud.colors) {
        for value in position.to_array() {
            bytes.extend((value as f32).to_le_bytes());
        }
        bytes.extend(color);
        if with_alpha {
            bytes.push(255);
        }
    }
    bytes
}

/// A float32 array as numpy.save writes it.
pub(crate) fn npy(values: &[f32], shape: &str) -> Vec<u8> {
    let data: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    npy_with(
        &format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}"),
        &data,
    )
}

/// An array of version 1 with any header.
pub(crate) fn npy_with(header: &str, data: &[u8]) -> Vec<u8> {
    let padded = (10 + header.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((padded as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.resize(10 + padded - 1, b' ');
    bytes.push(b'\n');
    bytes.extend(data);
    bytes
}

/// A COLMAP model in text, one camera an image, of `model` with the parameters of a camera.
pub(crate) fn write_colmap<'a>(
    folder: &Folder,
    place: &str,
    views: impl Iterator<Item = &'a View>,
    model: &str,
    params: impl Fn(&Camera) -> Vec<f64>,
) {
    let (mut cameras, mut images) = (String::new(), String::new());
    for (i, view) in views.enumerate() {
        let camera = &view.camera;
        let (q, t) = (DQuat::from_mat3(&camera.rotation), camera.translation);
        let params: Vec<String> = params(camera).iter().map(f64::to_string).collect();
        cameras += &format!(
            "{i} {model} {} {} {}\n",
            camera.width,
            camera.height,
            params.join(" ")
        );
        images += &format!(
            "{i} {} {} {} {} {} {} {} {i} {}\n\n",
            q.w, q.x, q.y, q.z, t.x, t.y, t.z, camera.name
        );
    }
    folder.write(&format!("{place}/cameras.txt"), cameras);
    folder.write(&format!("{place}/images.txt"), images);
}

pub(crate) fn pinhole(camera: &Camera) -> Vec<f64> {
    vec![camera.fx, camera.fy, camera.cx, camera.cy]
}

/// VGGT's `demo_colmap.py`: `sparse/` with the cloud as points.ply.
pub(crate) fn vggt(scene: &Scene) -> Folder {
    let folder = Folder::empty();
    write_images(&folder, "images", views(scene));
    write_colmap(&folder, "sparse", views(scene), "PINHOLE", pinhole);
    folder.write("sparse/points.ply", ply(&scene.cloud, true));
    folder
}

/// MASt3R with GLOMAP: `SIMPLE_RADIAL` cameras and COLMAP's points.
pub(crate) fn mast3r(scene: &Scene) -> Folder {
    let folder = Folder::empty();
    write_images(&folder, "images", views(scene));
    let params = |c: &Camera| vec![c.fx, c.cx, c.cy, -0.05];
    write_colmap(
        &folder,
        "reconstruction/0",
        views(scene),
        "SIMPLE_RADIAL",
        params,
    );
    let point = |(i, (p, [r, g, b])): (usize, (&DVec3, &[u8; 3]))| {
        format!("{i} {} {} {} {r} {g} {b} 0.5\n", p.x, p.y, p.z)
    };
    let points = scene.cloud.positions.iter().zip(&scene.cloud.colors);
    let text: String = points.enumerate().map(point).collect();
    folder.write("reconstruction/0/points3D.txt", text);
    folder
}

/// InstantSplat's `init_geo.py` for 4 views.
pub(crate) fn instantsplat(scene: &Scene) -> Folder {
    let folder = Folder::empty();
    write_images(&folder, "images", views(scene));
    write_colmap(
        &folder,
        "sparse_4/0",
        scene.train.iter(),
        "PINHOLE",
        pinhole,
    );
    write_colmap(&folder, "sparse_4/1", scene.test.iter(), "PINHOLE", pinhole);
    folder.write("sparse_4/0/points3D.ply", ply(&scene.cloud, false));
    let confidence = scene.cloud.confidence.as_ref().expect("confidences");
    let shape = format!("({}, 1)", confidence.len());
    folder.write("sparse_4/0/confidence_dsp.npy", npy(confidence, &shape));
    folder
}

/// GaussianObject's `pred_poses.py` for 4 views, with test cameras.
pub(crate) fn gaussianobject(scene: &Scene) -> Folder {
    let folder = Folder::empty();
    write_images(&folder, "images", views(scene));
    let list = |views: &[View]| -> Value {
        let entry = |(id, view): (usize, &View)| {
            let camera = &view.camera;
            let c2w = camera.rotation.transpose();
            let rotation = [0, 1, 2].map(|row| c2w.row(row).to_array());
            json!({
                "id": id, "img_name": camera.name, "width": camera.width, "height": camera.height,
                "position": camera.center().to_array(),
                "rotation": rotation,
                "fx": camera.fx, "fy": camera.fy,
            })
        };
        views.iter().enumerate().map(entry).collect()
    };
    folder.write("dust3r_4.json", list(&scene.train).to_string());
    folder.write("dust3r_4_test.json", list(&scene.test).to_string());
    folder.write("dust3r_4.ply", ply(&scene.cloud, true));
    folder
}

/// Camera-to-world with the camera's axes multiplied by `axes`.
pub(crate) fn matrix(camera: &Camera, axes: [f64; 3]) -> Value {
    let c2w = camera.rotation.transpose() * DMat3::from_diagonal(DVec3::from(axes));
    let center = camera.center();
    let row = |r: usize| {
        let row = c2w.row(r);
        json!([row.x, row.y, row.z, center[r]])
    };
    json!([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
}

/// nerfstudio's transforms.json with intrinsics a frame, views apart and a cloud.
pub(crate) fn nerfstudio(scene: &Scene, axes: [f64; 3]) -> Folder {
    let folder = Folder::empty();
    write_images(&folder, "images", views(scene));
    let frame = |view: &View| {
        let camera = &view.camera;
        json!({
            "file_path": format!("./images/{}", camera.name),
            "transform_matrix": matrix(camera, axes),
            "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
            "w": camera.width, "h": camera.height, "camera_model": "OPENCV",
            "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0,
        })
    };
    let names = |views: &[View]| -> Value {
        let name = |view: &View| format!("images/{}", view.camera.name);
        views.iter().map(name).collect()
    };
    let file = json!({
        "frames": views(scene).map(frame).collect::<Value>(),
        "train_filenames": names(&scene.train),
        "val_filenames": [],
        "test_filenames": names(&scene.test),
        "ply_file_path": "sparse_pc.ply",
    });
    folder.write("transforms.json", file.to_string());
    folder.write("sparse_pc.ply", ply(&scene.cloud, false));
    folder
}

/// instant-ngp's transforms.json: shared intrinsics, distortion included, sizes as floats.
pub(crate) fn instant_ngp(scene: &Scene) -> Folder {
    let folder = Folder::empty();
    write_images(&folder, "images", views(scene));
    let frame = |view: &View| {
        json!({
            "file_path": format!("./images/{}", view.camera.name),
            "sharpness": 31.5,
            "transform_matrix": matrix(&view.camera, OPENGL),
        })
    };
    let camera = &scene.train[0].camera;
    let file = json!({
        "camera_angle_x": 2.0 * (0.5 * f64::from(camera.width) / camera.fx).atan(),
        "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
        "w": f64::from(camera.width), "h": f64::from(camera.height),
        "k1": 0.04, "k2": -0.03, "p1": 0.001, "p2": -0.002, "aabb_scale": 16,
        "frames": views(scene).map(frame).collect::<Value>(),
    });
    folder.write("transforms.json", file.to_string());
    folder.write("points3D.ply", ply(&scene.cloud, false));
    folder
}

/// A scene of NeRF's Blender set: an angle for the lens, images without suffix, no sizes.
pub(crate) fn blender(scene: &Scene) -> Folder {
    let folder = Folder::empty();
    for (name, views) in [("train", &scene.train), ("test", &scene.test)] {
        write_images(&folder, name, views.iter());
        let frame = |view: &View| {
            let stem = view.camera.name.trim_end_matches(".png");
            json!({
                "file_path": format!("./{name}/{stem}"),
                "rotation": 0.0125,
                "transform_matrix": matrix(&view.camera, OPENGL),
            })
        };
        let camera = &scene.train[0].camera;
        let file = json!({
            "camera_angle_x": 2.0 * (0.5 * f64::from(camera.width) / camera.fx).atan(),
            "frames": views.iter().map(frame).collect::<Value>(),
        });
        folder.write(&format!("transforms_{name}.json"), file.to_string());
    }
    folder.write("points3D.ply", ply(&scene.cloud, false));
    folder
}
