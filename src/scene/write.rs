//! This module writes a scene folder in the program's own layout.

use std::fmt::Write as _;
use std::path::Path;

use glam::DQuat;

use super::PointCloud;
use super::origin::comments;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::files::{create_dir, write_file};

/// Writes a COLMAP model as text, `sparse/0/`, with a cloud as `points3D.ply`. Cameras are PINHOLE,
/// one an image, in their own order; `views` tells of each point which of them it came from.
/// `split.json` makes all of them training views.
///
/// # Errors
/// What keeps a file from being written.
pub fn write_model(
    dir: &Path,
    cameras: &[Camera],
    cloud: &PointCloud,
    views: &[u32],
) -> Result<()> {
    let model = dir.join("sparse/0");
    create_dir(&model)?;
    let mut lines = [
        String::from("# CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy\n"),
        String::from("# IMAGE_ID qw qx qy qz tx ty tz CAMERA_ID NAME; observations, none\n"),
    ];
    for (camera, id) in cameras.iter().zip(1..) {
        let Camera {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            translation: t,
            name,
            ..
        } = camera;
        let q = DQuat::from_mat3(&camera.rotation).normalize();
        // Writing to a String cannot fail.
        let _ = writeln!(
            lines[0],
            "{id} PINHOLE {width} {height} {fx} {fy} {cx} {cy}"
        );
        let _ = writeln!(
            lines[1],
            "{id} {} {} {} {} {} {} {} {id} {name}\n",
            q.w, q.x, q.y, q.z, t.x, t.y, t.z
        );
    }
    write_file(&model.join("cameras.txt"), lines[0].as_bytes())?;
    write_file(&model.join("images.txt"), lines[1].as_bytes())?;
    let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
    write_cloud(&model.join("points3D.ply"), cloud, views, &names)?;
    let split = serde_json::json!({ "train": names, "test": [] });
    write_file(&dir.join("split.json"), format!("{split:#}\n").as_bytes())
}

/// Writes a cloud as binary PLY: positions, colours, `confidence`, and the number of the view that
/// each point came from, from 0; comments say which of `names` a number is.
///
/// # Errors
/// What keeps the file from being written, or not one view a point.
pub fn write_cloud(path: &Path, cloud: &PointCloud, views: &[u32], names: &[&str]) -> Result<()> {
    if views.len() != cloud.len() {
        return Err(
            Error::new(format!("{} views for {} points", views.len(), cloud.len())).at_path(path),
        );
    }
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\n{}element vertex {}\nproperty float x\nproperty float \
         y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         property float confidence\nproperty uint view\nend_header\n",
        comments(names),
        cloud.len()
    )
    .into_bytes();
    for (i, (position, color)) in cloud.positions.iter().zip(&cloud.colors).enumerate() {
        for value in position.as_vec3().to_array() {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend(color);
        let confidence = cloud
            .confidence
            .as_ref()
            .map_or(1.0, |confidence| confidence[i]);
        bytes.extend(confidence.to_le_bytes());
        bytes.extend(views[i].to_le_bytes());
    }
    write_file(path, &bytes)
}
