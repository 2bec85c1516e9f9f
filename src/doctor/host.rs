//! The stages that run on the CPU: the potential field and the point splat.

use glam::DVec3;

use super::finding::Findings;
use super::rig::twin_of;
use super::stage;
use super::timing::{Clock, Timing};
use crate::camera::{Camera, Frame};
use crate::cloud::splat::splat_views;
use crate::config::{Config, Kernel};
use crate::doctor::twin::cases::Random;
use crate::doctor::twin::field::{TwinPotentials, potentials};
use crate::doctor::twin::splat::{filtered, nearest_points};
use crate::doctor::twin::tolerance;
use crate::error::Result;
use crate::field::{Field, fibonacci_sphere};
use crate::scene::PointCloud;

/// Holds `U_info` and `U_conf` over the candidate grid for four training directions.
pub fn examine_field(config: &Config) -> (Findings, Timing) {
    let n = config.field.n_candidates;
    let mut random = Random::new(21);
    let mut unit = || DVec3::from_array([(); 3].map(|()| random.normal())).normalize();
    let directions: Vec<DVec3> = (0..4).map(|_| unit()).collect();
    let [sech, von_mises_fisher] = [Kernel::Sech, Kernel::VonMisesFisher].map(|kernel| Field {
        directions: directions.clone(),
        kernel,
        sigma: config.field.sigma,
        lambda: config.field.lambda,
    });
    let grid = fibonacci_sphere(n);
    let clock = Clock::start();
    let info: Vec<f64> = grid.iter().map(|p| sech.u_info(*p)).collect();
    let conf: Vec<f64> = grid.iter().map(|p| sech.u_conf(*p)).collect();
    let seconds = clock.seconds();
    let other: Vec<f64> = grid.iter().map(|p| von_mises_fisher.u_info(*p)).collect();

    let directions: Vec<[f64; 3]> = directions.iter().map(DVec3::to_array).collect();
    let of = |p: &DVec3| potentials(&p.to_array(), &directions, config.field.sigma);
    let twin: Vec<TwinPotentials> = grid.iter().map(of).collect();
    let column = |pick: fn(&TwinPotentials) -> f64| twin.iter().map(pick).collect::<Vec<f64>>();
    let mut out = Findings::of(format!("{n} directions, 4 cameras"));
    for (what, ours, theirs) in [
        ("U_info", info, column(|u| u.sech)),
        (
            "U_info, von Mises-Fisher",
            other,
            column(|u| u.von_mises_fisher),
        ),
        ("U_conf", conf, column(|u| u.conf)),
    ] {
        out.close((stage::FIELD, what), &ours, &theirs, tolerance::FIELD);
    }
    let timing = Timing::wall(stage::FIELD, n, "directions", seconds);
    (out, timing)
}

/// Points and image of the point splat's case.
const N_POINTS: usize = 4000;
const SPLAT_SIZE: (u32, u32) = (97, 63);

/// Holds colours and mask of a splatted cloud, to the pixel.
///
/// # Errors
/// None in practice: the settings are allowed ones.
pub fn examine_point_splat(config: &Config) -> Result<(Findings, Timing)> {
    let mut random = Random::new(22);
    let cloud = PointCloud {
        positions: (0..N_POINTS)
            .map(|_| DVec3::from_array([(); 3].map(|()| random.uniform(-1.0, 1.0))))
            .collect(),
        colors: (0..N_POINTS as u32)
            .map(|i| [i as u8, (i >> 8) as u8, 77])
            .collect(),
        confidence: None,
    };
    let camera = {
        let any = super::rig::camera_of(&crate::doctor::twin::cases::cameras()[0]);
        any.resized(SPLAT_SIZE.0, SPLAT_SIZE.1)
    };
    let near = config.model.near;
    let mut out = Findings::of(format!(
        "{N_POINTS} points {}x{}",
        camera.width, camera.height
    ));
    let mut seconds = 0.0;
    for size_px in [1, 2] {
        let mut splat = config.splat.clone();
        splat.size_px = size_px;
        let clock = Clock::start();
        let cameras = std::slice::from_ref(&camera);
        let images = splat_views(&cloud, &Frame::IDENTITY, cameras, &splat, near)?;
        if size_px == 1 {
            seconds = clock.seconds();
        }
        let window = (splat.filter_window_px, splat.filter_min_neighbors);
        let expected = expected_splat(&cloud, &camera, near, size_px, window);
        let ours = images.first().map_or(&[][..], |image| &image.rgba);
        let what = format!("bytes, squares of {size_px}");
        out.equal((stage::POINT_SPLAT, &what), ours, &expected);
    }
    let timing = Timing::wall(stage::POINT_SPLAT, N_POINTS, "points", seconds);
    Ok((out, timing))
}

/// RGBA of the splat by brute force.
fn expected_splat(
    cloud: &PointCloud,
    camera: &Camera,
    near: f64,
    size_px: u32,
    (window, min): (u32, u32),
) -> Vec<u8> {
    let points: Vec<[f64; 3]> = cloud.positions.iter().map(DVec3::to_array).collect();
    let nearest = nearest_points(&points, &twin_of(camera, near), size_px as usize);
    let covered: Vec<bool> = nearest.iter().map(Option::is_some).collect();
    let kept = filtered(
        &covered,
        camera.width as usize,
        window as usize,
        min as usize,
    );
    let texel = |(point, kept): (&Option<usize>, &bool)| match point.filter(|_| *kept) {
        Some(i) => {
            let [r, g, b] = cloud.colors[i];
            [r, g, b, 255]
        }
        None => [0; 4],
    };
    nearest.iter().zip(&kept).flat_map(texel).collect()
}
