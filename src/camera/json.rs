//! `cameras.json`: camera poses as 3DGS writes them, with the principal point beside.

use std::path::{Component, Path};

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::camera::{Camera, check_lens, nearest_rotation};
use crate::error::{Error, Result};
use crate::files::{read_file, write_file};

/// One camera as 3DGS writes it; other keys are ignored.
#[derive(Serialize, Deserialize)]
#[serde(expecting = "an object that describes a camera")]
struct Entry {
    #[serde(default)]
    id: u64,
    img_name: String,
    width: u32,
    height: u32,
    /// Optical centre in the world, `-R^T t`.
    position: [f64; 3],
    /// Vector to add to the position; the PLY beside the file is stored without it, too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    offset: Option<[f64; 3]>,
    /// Rows of the camera-to-world rotation, `R^T`.
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
    /// Principal point, pixels; `None` in 3DGS's own files, which centre it.
    cx: Option<f64>,
    cy: Option<f64>,
    /// The photograph whose camera is turned the least against this one, where that is told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reference: Option<String>,
}

/// Writes cameras in the world frame. `offset` is taken out of their positions, as it is out of
/// those of the Gaussians beside them ([`crate::camera::Frame::offset`]), and noted if it is not
/// zero.
///
/// # Errors
/// The file cannot be written.
pub fn write_cameras(path: &Path, cameras: &[Camera], offset: DVec3) -> Result<()> {
    let entries = cameras.iter().zip(0..);
    let entries: Vec<Entry> = entries
        .map(|(camera, id)| Entry {
            offset: (offset != DVec3::ZERO).then(|| offset.to_array()),
            position: (camera.center() - offset).to_array(),
            ..Entry::of(camera, id)
        })
        .collect();
    write_entries(path, &entries)
}

/// Writes the cameras of images, in the world frame, under the images' names; each with the name of the camera of
/// `references` that is turned the least against it, the first of equal ones, if there is any.
///
/// # Errors
/// The file cannot be written.
pub fn write_views(path: &Path, views: &[(&str, &Camera)], references: &[Camera]) -> Result<()> {
    let nearest = |camera: &Camera| {
        let turn = |other: &&Camera| camera.difference(other).turn;
        let nearest = references.iter().min_by(|a, b| turn(a).total_cmp(&turn(b)));
        nearest.map(|camera| camera.name.clone())
    };
    let entries = views.iter().zip(0..);
    let entries: Vec<Entry> = entries
        .map(|((image, camera), id)| Entry {
            img_name: (*image).to_owned(),
            reference: nearest(camera),
            ..Entry::of(camera, id)
        })
        .collect();
    write_entries(path, &entries)
}

fn write_entries(path: &Path, entries: &[Entry]) -> Result<()> {
    let json = serde_json::to_string_pretty(entries)
        .map_err(|e| Error::new(format!("cannot be written as JSON: {e}")).at_path(path))?;
    write_file(path, json.as_bytes())
}

/// Reads cameras in the world frame, in the file's order; `cx`, `cy` default to the centre.
///
/// # Errors
/// The file cannot be read or is no JSON list of cameras, or an entry is no camera or repeats a
/// name. The error names the file, and the line or the entry.
pub fn read_cameras(path: &Path) -> Result<Vec<Camera>> {
    let bytes = read_file(path)?;
    let entries: Vec<Value> = serde_json::from_slice(&bytes)
        .map_err(|e| Error::new(format!("not a JSON list of cameras: {e}")).at_path(path))?;
    let mut cameras: Vec<Camera> = Vec::with_capacity(entries.len());
    let mut names = std::collections::HashSet::with_capacity(entries.len());
    for (i, value) in entries.into_iter().enumerate() {
        let camera = Entry::deserialize(value)
            .map_err(|e| Error::new(e.to_string()))
            .and_then(Entry::into_camera)
            .map_err(|e| e.at(format!("entry {i}")).at_path(path))?;
        if !names.insert(camera.name.clone()) {
            return Err(
                Error::new(format!("the name `{}` was used before", camera.name))
                    .at(format!("entry {i}"))
                    .at_path(path),
            );
        }
        cameras.push(camera);
    }
    Ok(cameras)
}

impl Entry {
    /// Describes a camera in the world frame.
    fn of(camera: &Camera, id: u64) -> Entry {
        Entry {
            id,
            img_name: camera.name.clone(),
            width: camera.width,
            height: camera.height,
            position: camera.center().to_array(),
            offset: None,
            // Columns of R are rows of R^T.
            rotation: camera.rotation.to_cols_array_2d(),
            fx: camera.fx,
            fy: camera.fy,
            cx: Some(camera.cx),
            cy: Some(camera.cy),
            reference: None,
        }
    }

    fn into_camera(self) -> Result<Camera> {
        let name = self.img_name;
        // Renders are stored under these names.
        let plain = |c: Component| matches!(c, Component::Normal(_));
        if name.is_empty() || name.contains('\0') || !Path::new(&name).components().all(plain) {
            return Err(Error::new(format!(
                "img_name {name:?} is not a plain relative file name"
            )));
        }
        if self.width == 0 || self.height == 0 {
            return Err(Error::new(format!(
                "the image size is {}x{}",
                self.width, self.height
            )));
        }
        let (cx, cy) = (
            self.cx.unwrap_or(0.5 * f64::from(self.width)),
            self.cy.unwrap_or(0.5 * f64::from(self.height)),
        );
        check_lens([self.fx, self.fy], [cx, cy])?;
        let rotation =
            nearest_rotation(DMat3::from_cols_array_2d(&self.rotation)).ok_or_else(|| {
                Error::new(
                    "`rotation` is not a rotation matrix: its rows must be orthonormal and \
                     right-handed",
                )
            })?;
        let offset = self.offset.map_or(DVec3::ZERO, DVec3::from_array);
        let translation = -(rotation * (DVec3::from_array(self.position) + offset));
        if !translation.is_finite() {
            return Err(Error::new("`position` is too large"));
        }
        Ok(Camera {
            name,
            width: self.width,
            height: self.height,
            fx: self.fx,
            fy: self.fy,
            cx,
            cy,
            rotation,
            translation,
        })
    }
}
