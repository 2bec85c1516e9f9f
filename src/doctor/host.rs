//! The stages that run on the CPU: the potential field and the point splat.

use glam::DVec3;

use super::finding::Findings;
use super::rig::twin_of;
use super::stage;
use super::timing::{Clock, Timing};
use crate::camera::{Camera, Frame};
use crate::cloud::splat::splat_views;
use crate::config::{Config, Footprint, Kernel, MIN_DISC_RADIUS_PX, SplatConfig};
use crate::doctor::twin::field::{TwinPotentials, potentials};
use crate::doctor::twin::random::Random;
use crate::doctor::twin::splat::{blended, filtered, nearest_points, source_radii};
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

/// Holds colours and mask of a splatted cloud to brute force: single pixels to the byte, discs to
/// the level.
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
    let [camera, source] = [0, 1].map(|i| {
        let any = super::rig::camera_of(&crate::doctor::twin::cases::cameras()[i]);
        any.resized(SPLAT_SIZE.0, SPLAT_SIZE.1)
    });
    let case = SplatCase {
        near: config.model.near,
        cloud,
        camera,
        source,
    };
    let clock = Clock::start();
    let mut findings = examine_splat(&case, &splat_config(config, Footprint::Pixel))?;
    let seconds = clock.seconds();
    let discs = examine_splat(&case, &splat_config(config, Footprint::Disc))?;
    findings.list.extend(discs.list);
    let timing = Timing::wall(stage::POINT_SPLAT, N_POINTS, "points", seconds);
    Ok((findings, timing))
}

fn splat_config(config: &Config, footprint: Footprint) -> SplatConfig {
    SplatConfig {
        footprint,
        ..config.splat.clone()
    }
}

/// A cloud to splat into one camera.
pub struct SplatCase {
    /// Points to splat, in the frame of the cameras.
    pub cloud: PointCloud,
    /// Camera that they are splatted into.
    pub camera: Camera,
    /// Camera from which discs have their radii.
    pub source: Camera,
    /// Near plane: camera z up to which no point is seen.
    pub near: f64,
}

/// Holds the splat of `case` to brute force.
///
/// # Errors
/// The settings or views are such as [`splat_views`] refuses.
pub fn examine_splat(case: &SplatCase, config: &SplatConfig) -> Result<Findings> {
    let SplatCase {
        cloud,
        camera,
        source,
        near,
    } = case;
    let mut out = Findings::of(format!(
        "{} points {}x{}",
        cloud.len(),
        camera.width,
        camera.height
    ));
    let one = std::slice::from_ref;
    let views = (one(camera), one(source));
    let images = splat_views(cloud, &Frame::IDENTITY, views, config, *near)?;
    let ours = images.first().map_or(&[][..], |image| &image.rgba);
    let expected = expected_splat(case, config);
    let mask: Vec<bool> = ours.chunks_exact(4).map(|p| p[3] == 255).collect();
    let covered: Vec<bool> = expected.iter().map(Option::is_some).collect();
    let name = format!("{:?}", config.footprint).to_lowercase();
    let what = |part: &str| format!("{part}, {name}");
    out.equal((stage::POINT_SPLAT, &what("mask")), &mask, &covered);
    let ours: Vec<f64> = ours
        .chunks_exact(4)
        .flat_map(|p| [p[0], p[1], p[2]].map(f64::from))
        .collect();
    let theirs: Vec<f64> = expected
        .iter()
        .flat_map(|color| color.unwrap_or_default())
        .collect();
    let bound = match config.footprint {
        Footprint::Pixel => 0.0,
        Footprint::Disc => tolerance::SPLAT_LEVELS,
    };
    let largest = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs());
    let largest = largest.fold(0.0, f64::max);
    out.add((stage::POINT_SPLAT, &what("levels")), largest, bound);
    Ok(out)
}

/// Returns the colour of every pixel by brute force, 0 to 255; `None` where no point shows.
fn expected_splat(case: &SplatCase, config: &SplatConfig) -> Vec<Option<[f64; 3]>> {
    let (near, cloud) = (case.near, &case.cloud);
    let points: Vec<[f64; 3]> = cloud.positions.iter().map(DVec3::to_array).collect();
    let camera = twin_of(&case.camera, near);
    let colors: Vec<Option<[f64; 3]>> = match config.footprint {
        Footprint::Pixel => nearest_points(&points, &camera)
            .into_iter()
            .map(|nearest| nearest.map(|i| cloud.colors[i].map(f64::from)))
            .collect(),
        Footprint::Disc => {
            let radii = source_radii(&points, &[twin_of(&case.source, near)]);
            let colored: Vec<_> = points.into_iter().zip(cloud.colors.clone()).collect();
            let bounds = [MIN_DISC_RADIUS_PX, config.max_radius_px];
            blended(&colored, &radii, &camera, bounds, config.depth_tolerance)
        }
    };
    let covered: Vec<bool> = colors.iter().map(Option::is_some).collect();
    let kept = filtered(
        &covered,
        case.camera.width as usize,
        config.filter_window_px as usize,
        config.filter_min_neighbors as usize,
    );
    colors
        .into_iter()
        .zip(kept)
        .map(|(color, kept)| color.filter(|_| kept))
        .collect()
}
