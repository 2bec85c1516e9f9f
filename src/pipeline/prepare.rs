//! This module does everything between the scene and the first iteration: focus, field, carving,
//! virtual views, their point splats, and the Gaussians to start from.

use glam::DVec3;
use rayon::prelude::*;

use super::priors::set_depths;
use super::{Clock, cameras, focus_of, marks};
use crate::camera::{Camera, Frame};
use crate::cloud::agreement::Agreement;
use crate::cloud::carve::{Carved, carve};
use crate::cloud::hull::visual_hull;
use crate::cloud::outline::Outline;
use crate::cloud::splat::{SplatImage, fill_holes, splat_where};
use crate::cloud::visibility::{Visibility, candidate_shares};
use crate::cloud::warp::Warp;
use crate::config::{Config, Start, VisibilityConfig};
use crate::error::Result;
use crate::field::{Coverage, Field, Focus, Outlook, fibonacci_sphere};
use crate::gaussians::Gaussians;
use crate::run::Seconds;
use crate::scene::{Image, PointCloud, Scene, View, thin};
use crate::terminal::progress::Progress;
use crate::train::{Goal, Shell, Supervision, TrainingView};
use crate::views::{VirtualView, candidates, virtual_views};

/// Most portions that splatting is done in: each goes through all points once to place them.
const N_PORTIONS: usize = 16;

/// 3DGS's camera extent, in spreads of the training cameras.
const EXTENT: f64 = 1.1;

/// Cameras that spread less than this share of `R` stand in one place. Their extent would be 0:
/// positions would not move, and every Gaussian would be pruned for its size. They get that of
/// cameras which stand all around the sphere.
const MIN_SPREAD: f64 = 1e-6;

/// All that training starts from.
pub struct Prepared {
    /// From the scene's own frame to the canonical one.
    pub frame: Frame,
    /// The cloud that all of this is made from, where it is not the scene's own.
    pub carved: Option<Carved>,
    /// The virtual cameras, world frame.
    pub virtual_cameras: Vec<Camera>,
    /// All that the optimiser learns from, canonical frame.
    pub supervision: Supervision,
    /// The first Gaussians, canonical frame.
    pub start: Gaussians,
    /// Lines for the log.
    pub warnings: Vec<String>,
}

/// Prepares `scene` as `config` says; adds the stages' times to `seconds`.
///
/// # Errors
/// A camera layout without a sphere, more virtual views than candidates, no candidate that shows
/// what a camera sees where the config asks for that, or an empty cloud.
pub fn prepare(scene: &Scene, config: &Config, seconds: &mut Seconds) -> Result<Prepared> {
    let train_cameras = cameras(&scene.train);
    let mut clock = Clock::start();
    let (focus, frame) = focus_of(scene)?;
    let field = Field::new(&train_cameras, &focus, &config.field);
    let coverage = Coverage::new(&field, &fibonacci_sphere(config.field.n_candidates));
    seconds.field = Some(clock.lap());
    let carved = carved(scene, &frame, config)?;
    seconds.carve = carved.as_ref().map(|_| clock.lap());
    let cloud = carved.as_ref().map_or(&scene.cloud, |c| &c.cloud);
    let virtual_views =
        choose_views(&train_cameras, (&focus, &field), cloud, config).map_err(|e| {
            match Agreement::of(scene) {
                Ok(agreement) => agreement.explain(e),
                Err(cause) => cause,
            }
        })?;
    let virtual_cameras: Vec<Camera> = virtual_views.iter().map(|v| v.camera.clone()).collect();
    seconds.sample = Some(clock.lap());
    let fill_weight = match is_cut_out(scene) {
        true => 0.0,
        false => config.loss.fill_weight,
    };
    let warp = match virtual_cameras.is_empty() {
        true => None,
        false => Warp::new(
            cloud,
            &frame,
            &scene.train,
            config,
            frame.near(config.model.near),
        )?,
    };
    let cameras = (&virtual_cameras[..], &train_cameras[..]);
    let outline = outline(&scene.train, cloud, &frame, config);
    let painted = (fill_weight, warp.as_ref(), outline.as_ref());
    let goals = splatted(cloud, &frame, cameras, painted, config)?;
    seconds.splat = Some(clock.lap());

    let hull = match config.model.start {
        Start::Hull => Some(visual_hull(&scene.train, &frame)?),
        Start::Cloud => None,
    };
    let n_start = match &hull {
        Some(hull) => config.scene.max_points.unwrap_or(hull.len()),
        None => n_start(scene, config),
    };
    let thinned = thin(hull.as_ref().unwrap_or(cloud), n_start, config.seed);
    let mut start = Gaussians::from_cloud(&thinned, &frame, &config.model)?;
    let shell = Shell::around(&start, &config.shell).filter(|_| !is_cut_out(scene));
    if let Some(shell) = shell {
        start.extend(shell.gaussians(mean_color(&scene.train), config.model.sh_degree));
    }
    let position_gains = position_gains(&thinned, start.len(), config);
    let outlook = Outlook::of(&train_cameras, &focus);
    let mut warnings: Vec<String> = focus.fallback.into_iter().collect();
    warnings.extend(outlook.warning(&train_cameras));
    warnings.extend(carved.as_ref().and_then(|c| c.warning.clone()));
    warnings.extend(warp.and_then(|w| w.warning));
    if is_cut_out(scene) && (config.shell.count > 0 || config.loss.fill_weight > 0.0) {
        warnings.push(
            "the subject is cut out by its masks: no far shell and no filled holes".to_owned(),
        );
    }
    if is_cut_out(scene) && wants_outline(config) && outline.is_none() {
        warnings.push(
            "virtual views do not show the background: the masks bound no subject that holds the cloud; is it whole in every \
             photograph?"
                .to_owned(),
        );
    }
    if config.optimizer.confidence_gain > 0.0 && thinned.confidence.is_none() {
        warnings.push(
            "the cloud has no confidences: all positions learn at the same rate, whatever \
             optimizer.confidence_gain says"
                .to_owned(),
        );
    }
    let spread = spread(&train_cameras, &frame);
    if spread < MIN_SPREAD {
        warnings.push(
            "the training cameras stand in one place: their extent is taken for that of cameras \
             all around the sphere"
                .to_owned(),
        );
    }
    if virtual_views.len() < config.views.count && config.views.within_deg.is_none() {
        warnings.push(format!(
            "{} virtual views instead of {} (views.count): no other candidate reaches \
             views.visibility.min_share, {}",
            virtual_views.len(),
            config.views.count,
            config.views.visibility.min_share
        ));
    }
    let mut supervision = Supervision {
        shell,
        position_gains,
        ..supervision(
            scene,
            (&frame, spread),
            coverage,
            &virtual_views,
            goals,
            config,
        )
    };
    supervision.real = marks::marked(supervision.real, scene, (cloud, &frame), config)?;
    warnings.extend(marks::warning(&supervision.real, config));
    set_depths(&mut supervision.real, scene, cloud, &frame, config)?;
    if config.need.ends && config.need.hold_out > 0 && supervision.held_out.is_empty() {
        warnings.push(format!(
            "no virtual view is held out, so that nothing ends training early: there are {}, and one \
             in {} is (need.hold_out) if it shows a point",
            virtual_views.len(),
            config.need.hold_out
        ));
    }
    seconds.gaussians = Some(clock.lap());
    Ok(Prepared {
        supervision,
        warnings,
        carved,
        frame,
        virtual_cameras,
        start,
    })
}

/// Returns the number of points that training on `scene` starts from: `scene.max_points`, else one
/// for `scene.pixels_a_point` training pixels, at least one, and no more than the cloud has before
/// carving.
pub fn n_start(scene: &Scene, config: &Config) -> usize {
    let n_pixels: usize = scene.train.iter().map(|view| n_pixels(&view.image)).sum();
    let by_pixels = || ((n_pixels as f64 / config.scene.pixels_a_point) as usize).max(1);
    let wanted = config.scene.max_points.unwrap_or_else(by_pixels);
    wanted.min(scene.cloud.len())
}

/// Returns what is added to 1 for the factor of each position's learning rate, for the Gaussians of
/// `cloud` and those beyond, `n` in all; nothing if all have the same.
fn position_gains(cloud: &PointCloud, n: usize, config: &Config) -> Vec<f32> {
    let most = config.optimizer.confidence_gain;
    let Some(confidence) = cloud.confidence.as_ref().filter(|_| most > 0.0) else {
        return Vec::new();
    };
    let gain = |c: &f32| (most / (1.0 + f64::from(*c).exp())) as f32;
    let mut gains: Vec<f32> = confidence.iter().map(gain).collect();
    // The far shell's geometry is frozen.
    gains.resize(n, 0.0);
    gains
}

/// Returns whether the subject stands before the background colour: then nothing lies beyond it.
fn is_cut_out(scene: &Scene) -> bool {
    scene.train.iter().any(View::is_cut_out)
}

/// Returns the outline that virtual views have, if `config` asks for it and the subject is cut out.
fn outline(train: &[View], cloud: &PointCloud, frame: &Frame, config: &Config) -> Option<Outline> {
    let (ground, radius) = (config.model.background, config.splat.max_radius_px);
    wants_outline(config)
        .then(|| Outline::of(train, cloud, frame, ground, radius))
        .flatten()
}

fn wants_outline(config: &Config) -> bool {
    config.splat.outline && config.views.count > 0 && !config.loss.random_background
}

/// Carves the scene's cloud if `config` asks for it.
pub(super) fn carved(scene: &Scene, frame: &Frame, config: &Config) -> Result<Option<Carved>> {
    let near = frame.near(config.model.near);
    config
        .carve
        .enabled
        .then(|| carve(&scene.cloud, frame, &scene.train, &config.carve, near))
        .transpose()
}

/// Chooses the virtual views; they are weighed by what they show of `cloud` where `config` asks for
/// it.
pub(super) fn choose_views(
    train: &[Camera],
    (focus, field): (&Focus, &Field),
    cloud: &PointCloud,
    config: &Config,
) -> Result<Vec<VirtualView>> {
    let shares = if config.views.visibility.enabled && config.views.count > 0 {
        let candidates = candidates(train, focus, field, config)?;
        let candidates: Vec<Camera> = candidates.into_iter().map(|v| v.camera).collect();
        Some(candidate_shares(
            &candidates,
            cloud,
            &focus.frame(),
            train,
            config,
        )?)
    } else {
        None
    };
    virtual_views(train, focus, field, shares.as_deref(), config)
}

/// Splats the cloud into the virtual views as their target images, as far as the training cameras
/// see it if `config` asks for that, and has the `warp` paint them and the `outline` bound them. It goes portion by portion to show how far it is, and packs so
/// that never more than a portion is held as it is.
fn splatted(
    cloud: &PointCloud,
    frame: &Frame,
    (cameras, train): (&[Camera], &[Camera]),
    (fill_weight, warp, outline): (f64, Option<&Warp<'_>>, Option<&Outline>),
    config: &Config,
) -> Result<Vec<Goal>> {
    let near = frame.near(config.model.near);
    let visibility = &config.views.visibility;
    let seen = visibility.mask_angle_deg.map(|max_angle_deg| {
        let within = VisibilityConfig {
            max_angle_deg,
            ..visibility.clone()
        };
        Visibility::new(cloud, cloud, frame, train, &within, near)
    });
    let seen = seen.transpose()?;
    let shows =
        |point: usize, eye: DVec3| seen.as_ref().is_none_or(|seen| seen.is_seen(point, eye));
    let n_least = 4 * rayon::current_num_threads();
    let portion = cameras.len().div_ceil(N_PORTIONS).max(n_least);
    let mut progress = Progress::stage("splatting", cameras.len() as u32);
    let mut goals = Vec::with_capacity(cameras.len());
    for part in cameras.chunks(portion) {
        let mut splats = splat_where(cloud, frame, (part, train), &config.splat, near, shows)?;
        if let Some(warp) = warp {
            warp.paint(part, &mut splats)?;
        }
        if let Some(outline) = outline {
            let views = part.par_iter().zip(&mut splats);
            views.for_each(|(camera, splat)| outline.draw(camera, splat));
        }
        goals.extend(virtual_goals(splats, fill_weight));
        progress.advance(goals.len() as u32);
    }
    progress.finish();
    Ok(goals)
}

/// Gathers the views that the optimiser learns from, in the canonical frame.
fn supervision(
    scene: &Scene,
    (frame, spread): (&Frame, f64),
    coverage: Coverage,
    virtual_views: &[VirtualView],
    goals: Vec<Goal>,
    config: &Config,
) -> Supervision {
    let of = match config.loss.random_background {
        true => TrainingView::before_any_background,
        false => TrainingView::of,
    };
    let real = scene
        .train
        .iter()
        .map(|view| of(frame.camera_to_canonical(&view.camera), view));
    let virtual_views = virtual_views.iter().zip(goals).map(|(view, goal)| {
        TrainingView::packed(frame.camera_to_canonical(&view.camera), goal, view.alpha)
    });
    let (held_out, virtual_views) = held_out(virtual_views.collect(), config.need.hold_out);
    Supervision {
        extent: EXTENT * if spread < MIN_SPREAD { 1.0 } else { spread },
        near: frame.near(config.model.near),
        real: real.collect(),
        virtual_views,
        held_out,
        coverage,
        shell: None,
        position_gains: Vec::new(),
    }
}

/// Splits virtual views into those held out, every `one_in`-th in their order, and the others. The order is that of the draw,
/// so that the seed decides which; at 0, or where a view shows no point, it stays with the others.
fn held_out(views: Vec<TrainingView>, one_in: usize) -> (Vec<TrainingView>, Vec<TrainingView>) {
    let is_held_out = |i: usize, view: &TrainingView| {
        one_in > 0 && i % one_in == one_in - 1 && view.goal.has_opaque()
    };
    let (mut held_out, mut others) = (Vec::new(), Vec::with_capacity(views.len()));
    for (i, view) in views.into_iter().enumerate() {
        match is_held_out(i, &view) {
            true => held_out.push(view),
            false => others.push(view),
        }
    }
    (held_out, others)
}

/// Makes the target images of the virtual views: the splats, with alpha 255 times the weight of a
/// pixel as [`TrainingView`] wants it. At a `fill_weight` above 0 their holes are filled.
fn virtual_goals(splats: Vec<SplatImage>, fill_weight: f64) -> Vec<Goal> {
    let weight = (255.0 * fill_weight).round() as u8;
    let goal = |splat: SplatImage| {
        let texels: Vec<u32> = match weight {
            0 => bytemuck::pod_collect_to_vec(&splat.rgba),
            weight => bytemuck::pod_collect_to_vec(&fill_holes(&splat, weight)),
        };
        Goal::new(&texels)
    };
    splats.into_par_iter().map(goal).collect()
}

/// Returns the mean over all pixels that count, RGB in [0, 1].
fn mean_color(views: &[View]) -> DVec3 {
    let mut sum = [0_u64; 3];
    let mut n = 0_u64;
    for view in views {
        let pixels = view.image.rgb.chunks_exact(3).enumerate();
        for (_, pixel) in pixels.filter(|(i, _)| view.counts(*i)) {
            sum = std::array::from_fn(|c| sum[c] + u64::from(pixel[c]));
            n += 255;
        }
    }
    DVec3::from_array(sum.map(|s| s as f64 / n.max(1) as f64))
}

/// Returns the greatest distance of a camera from their mean, in `R`.
fn spread(cameras: &[Camera], frame: &Frame) -> f64 {
    let center = |camera: &Camera| frame.camera_to_canonical(camera).center();
    let centers: Vec<DVec3> = cameras.iter().map(center).collect();
    let mean = centers.iter().sum::<DVec3>() / centers.len().max(1) as f64;
    centers.iter().map(|c| c.distance(mean)).fold(0.0, f64::max)
}

fn n_pixels(image: &Image) -> usize {
    image.width as usize * image.height as usize
}
