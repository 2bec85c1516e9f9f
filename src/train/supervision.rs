//! The supervision is what a training run learns from.

use super::depth_target::DepthTarget;
use super::goal::Goal;
use super::shell::Shell;
use crate::camera::Camera;
use crate::field::Coverage;
use crate::gpu::constants::{FAR_ALPHA, LEVEL_MAX};
use crate::scene::View;

/// Alpha of a pixel that counts in full, and the bits of a colour.
const OPAQUE: u32 = u8::MAX as u32;
const COLOR: u32 = 0x00ff_ffff;

/// An image that a training view is compared with.
#[derive(Clone, Debug)]
pub struct TrainingView {
    /// Canonical frame.
    pub camera: Camera,
    /// `height * width`; alpha / 255 is the pixel's weight, but for the marks of [`TrainingView::with_far`]
    /// and [`TrainingView::with_silhouette`].
    pub goal: Goal,
    /// Sum of the pixels' weights.
    pub total_weight: f64,
    /// Whether pixels may weigh less than 1; SSIM's windows are normalised then.
    pub masked: bool,
    /// Weight of its loss: 1 for real views, `alpha_k` for virtual ones.
    pub weight: f64,
    /// Number of pixels that are marked as far.
    pub n_far: usize,
    /// Number of pixels of a view whose silhouette counts; 0: it does not.
    pub n_outlined: usize,
    /// Whether pixels of alpha 0 show the background of the iteration; all count then.
    pub has_ground: bool,
    /// Depths and normals that it is held to, too.
    pub depths: Option<DepthTarget>,
}

impl TrainingView {
    /// Takes a photograph in RGBA8: every pixel weighs 1, as does its loss.
    pub fn photograph(camera: Camera, goal: &[u32]) -> TrainingView {
        TrainingView {
            masked: false,
            ..Self::masked(camera, goal, 1.0)
        }
    }

    /// Takes the photograph of a scene's view; pixels that its mask leaves out of training weigh
    /// nothing.
    pub fn of(camera: Camera, view: &View) -> TrainingView {
        match view.counts_whole() {
            true => Self::photograph(camera, &view.goal()),
            false => Self::masked(camera, &view.goal(), 1.0),
        }
    }

    /// Does the same where backgrounds are random: around a cut-out subject the target image shows the background, too,
    /// whatever it is.
    pub fn before_any_background(camera: Camera, view: &View) -> TrainingView {
        if !view.is_cut_out() {
            return Self::of(camera, view);
        }
        let goal = view.goal().into_iter().enumerate();
        let goal = goal.map(|(i, texel)| if view.shows(i) { texel } else { 0 });
        let goal: Vec<u32> = goal.collect();
        TrainingView {
            masked: false,
            total_weight: goal.len() as f64,
            has_ground: true,
            ..Self::masked(camera, &goal, 1.0)
        }
    }

    /// Takes a target image in which every pixel weighs what its alpha says.
    pub fn masked(camera: Camera, goal: &[u32], weight: f64) -> TrainingView {
        Self::packed(camera, Goal::new(goal), weight)
    }

    /// Does the same for a target image that is packed already.
    pub fn packed(camera: Camera, goal: Goal, weight: f64) -> TrainingView {
        let total = goal.total_alpha();
        TrainingView {
            camera,
            goal,
            total_weight: total as f64 / LEVEL_MAX,
            masked: true,
            weight,
            n_far: 0,
            n_outlined: 0,
            has_ground: false,
            depths: None,
        }
    }

    /// Returns the photograph with those of its pixels marked, `height * width`, that the loss of the far
    /// pixels counts, as far as they count in full.
    pub fn with_far(self, far: &[bool]) -> TrainingView {
        let mut texels = self.goal.texels();
        let mut n_far = 0;
        for (texel, far) in texels.iter_mut().zip(far) {
            if *far && *texel >> 24 == OPAQUE {
                *texel = *texel & COLOR | FAR_ALPHA << 24;
                n_far += 1;
            }
        }
        let goal = Goal::new(&texels);
        TrainingView {
            total_weight: match self.masked {
                true => goal.total_alpha() as f64 / LEVEL_MAX,
                false => self.total_weight,
            },
            goal,
            n_far,
            ..self
        }
    }

    /// Returns the photograph of a cut-out subject with the pixels marked that do not show it: the
    /// silhouette counts then. `subject` is `height * width`; every pixel counts as before.
    pub fn with_silhouette(self, subject: &[bool]) -> TrainingView {
        let mut texels = self.goal.texels();
        for (texel, _) in texels.iter_mut().zip(subject).filter(|(_, shows)| !**shows) {
            *texel &= COLOR;
        }
        let n_far = texels.iter().filter(|t| **t >> 24 == FAR_ALPHA).count();
        TrainingView {
            goal: Goal::new(&texels),
            n_far: n_far.min(self.n_far),
            n_outlined: subject.len(),
            ..self
        }
    }

    /// Returns what a pixel of this view, RGBA8, weighs, from 0 to 1.
    pub fn weight_of(&self, texel: u32) -> f64 {
        match (self.masked, texel >> 24) {
            (false, _) => 1.0,
            (true, FAR_ALPHA) if self.n_far > 0 => 1.0,
            (true, alpha) => f64::from(alpha) / LEVEL_MAX,
        }
    }
}

/// All that a training run learns from, in the canonical frame.
#[derive(Clone, Debug)]
pub struct Supervision {
    /// The photographs, with the training cameras.
    pub real: Vec<TrainingView>,
    /// The splatted virtual views; empty in a run without them.
    pub virtual_views: Vec<TrainingView>,
    /// Virtual views that are not trained on, each with a pixel that shows a point: they measure.
    pub held_out: Vec<TrainingView>,
    /// Coverage scores, which decide coverage-aware pruning and densification.
    pub coverage: Coverage,
    /// 3DGS's camera extent in the canonical frame: 1.1 times the greatest distance of a training
    /// camera from their mean. Cameras in one place have 1.1, as if they stood around the sphere.
    pub extent: f64,
    /// Near plane, canonical.
    pub near: f64,
    /// The far shell, where the Gaussians have one.
    pub shell: Option<Shell>,
    /// What is added to 1 for the factor of a position's learning rate, one a Gaussian of the start; empty
    /// where all have the same rate.
    pub position_gains: Vec<f32>,
}

impl Supervision {
    /// Iterates over the views that are trained on: the real ones, then the virtual ones.
    pub fn trained(&self) -> impl Iterator<Item = &TrainingView> {
        self.real.iter().chain(&self.virtual_views)
    }

    /// Iterates over every view: those that are trained on, then those held out.
    pub fn views(&self) -> impl Iterator<Item = &TrainingView> {
        self.trained().chain(&self.held_out)
    }

    /// Returns the distance from the focus beyond which Gaussians learn colour alone and neither
    /// come nor go: those of the far shell.
    pub fn frozen_beyond(&self) -> f32 {
        let shell = self.shell;
        shell.map_or(f32::INFINITY, |shell| shell.inner_radius() as f32)
    }
}
