//! This module gathers what the page's scripts read: cameras, the field on a grid, and how the
//! Gaussians are packed.

use glam::DVec3;
use serde::Serialize;

use super::super::plot::viridis;
use super::packed::{PACKED_BYTES, SCALE_LOG};
use super::picture::base64;
use crate::camera::compass::Compass;
use crate::camera::{Camera, Frame};
use crate::config::Config;
use crate::error::Result;
use crate::field::{Field, Focus};
use crate::run::SceneRecord;

/// Rows of the field's grid: 2 degrees each.
const N_ROWS: usize = 90;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum CameraKind {
    Training,
    Virtual,
    Test,
    /// It belongs to no run: it was put there to look from.
    Placed,
}

#[derive(Debug, Serialize)]
pub(crate) struct CameraData {
    pub name: String,
    pub kind: CameraKind,
    /// Unit direction from the focus: front, right, up.
    direction: [f32; 3],
    /// Canonical frame.
    eye: [f32; 3],
    /// Rows of the world-to-camera rotation.
    rotation: [[f32; 3]; 3],
    /// Pixels, as are the sizes.
    focal: [f32; 2],
    /// The principal point, from the image's centre.
    principal: [f32; 2],
    size: [u32; 2],
}

/// A quantity on the grid, row by row from the zenith down, from azimuth -180 to the right.
#[derive(Debug, Serialize)]
struct Quantity {
    name: &'static str,
    unit: &'static str,
    min: f64,
    max: f64,
    /// u8, base64: shares of the stretch from `min` to `max`.
    values: String,
}

/// The camera potential field of the training cameras.
#[derive(Debug, Serialize)]
struct FieldData {
    n_rows: usize,
    quantities: Vec<Quantity>,
    /// 256 colours, RGB, base64.
    palette: String,
}

#[derive(Debug, Serialize)]
pub(crate) struct PageData {
    pub cameras: Vec<CameraData>,
    /// None without training cameras.
    #[serde(flatten)]
    field: Option<FieldData>,
    background: [f64; 3],
    near: f64,
    /// Canonical frame.
    up: [f32; 3],
    scale_log: [f32; 2],
    packed_bytes: usize,
}

impl PageData {
    /// Gathers what the scripts read: all `cameras`, in the world, and the canonical `frame`;
    /// `scene` is that of the run whose cameras they are.
    ///
    /// # Errors
    /// There is no camera.
    pub(crate) fn new(
        cameras: &[Camera],
        frame: &Frame,
        config: &Config,
        scene: Option<&SceneRecord>,
    ) -> Result<PageData> {
        let kind = |camera: &Camera| {
            let Some(scene) = scene else {
                return CameraKind::Placed;
            };
            if scene.train_views.contains(&camera.name) {
                CameraKind::Training
            } else if scene.test_views.contains(&camera.name) {
                CameraKind::Test
            } else {
                CameraKind::Virtual
            }
        };
        let is_training = |camera: &&Camera| kind(camera) == CameraKind::Training;
        let training: Vec<Camera> = cameras.iter().filter(is_training).cloned().collect();
        let has_field = !training.is_empty();
        let upright = if has_field { &training } else { cameras };
        let compass = Compass::of_cameras(upright, frame.center)?;
        Ok(PageData {
            cameras: cameras
                .iter()
                .map(|camera| camera_data(camera, kind(camera), frame, &compass))
                .collect(),
            field: has_field.then(|| FieldData::new(&training, frame, config, &compass)),
            background: config.model.background,
            near: frame.near(config.model.near),
            up: compass.up().as_vec3().to_array(),
            scale_log: [*SCALE_LOG.start(), *SCALE_LOG.end()],
            packed_bytes: PACKED_BYTES,
        })
    }

    /// Says whether there is a field to show.
    pub(crate) fn has_field(&self) -> bool {
        self.field.is_some()
    }

    pub(crate) fn n_cameras(&self, kind: CameraKind) -> usize {
        self.cameras.iter().filter(|c| c.kind == kind).count()
    }
}

impl FieldData {
    fn new(training: &[Camera], frame: &Frame, config: &Config, compass: &Compass) -> FieldData {
        let focus = Focus {
            center: frame.center,
            radius: frame.radius,
            extent: frame.extent,
            fallback: None,
        };
        let field = Field::new(training, &focus, &config.field);
        let palette: Vec<u8> = (0..=255)
            .flat_map(|i| viridis(f64::from(i) / 255.0))
            .collect();
        FieldData {
            n_rows: N_ROWS,
            quantities: quantities(&field, compass),
            palette: base64(&palette),
        }
    }
}

fn camera_data(camera: &Camera, kind: CameraKind, frame: &Frame, compass: &Compass) -> CameraData {
    let eye = frame.to_canonical(camera.center());
    let direction = eye.try_normalize().unwrap_or(-camera.forward());
    let row = |i: usize| camera.rotation.row(i).as_vec3().to_array();
    CameraData {
        name: camera.name.clone(),
        kind,
        direction: compass.local(direction).as_vec3().to_array(),
        eye: eye.as_vec3().to_array(),
        rotation: [row(0), row(1), row(2)],
        focal: [camera.fx as f32, camera.fy as f32],
        principal: [
            (camera.cx - 0.5 * f64::from(camera.width)) as f32,
            (camera.cy - 0.5 * f64::from(camera.height)) as f32,
        ],
        size: [camera.width, camera.height],
    }
}

fn quantities(field: &Field, compass: &Compass) -> Vec<Quantity> {
    let grid = compass.grid(N_ROWS);
    let quantity = |name, unit, value: &dyn Fn(DVec3) -> f64| {
        let values: Vec<f64> = grid.iter().map(|p| value(*p)).collect();
        let min = values.iter().copied().fold(f64::INFINITY, f64::min);
        let max = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // A flat field is all minimum.
        let span = if max > min { max - min } else { 1.0 };
        let shares = values
            .iter()
            .map(|v| (255.0 * (v - min) / span).round() as u8);
        Quantity {
            name,
            unit,
            min,
            max,
            values: base64(&shares.collect::<Vec<u8>>()),
        }
    };
    vec![
        quantity("U_total", "", &|p| field.u_total(p)),
        quantity("U_info", "", &|p| field.u_info(p)),
        quantity("U_conf", "degrees", &|p| field.u_conf(p).to_degrees()),
    ]
}
