//! The supervision is what a training run learns from.

use super::depth_target::DepthTarget;
use super::goal::Goal;
use super::shell::Shell;
use crate::camera::Camera;
use crate::field::Coverage;
use crate::gpu::constants::LEVEL_MAX;
use crate::scene::View;

/// An image that a training view is compared with.
#[derive(Clone, Debug)]
pub struct TrainingView {
    /// Canonical frame.
    pub camera: Camera,
    /// `height * width`; alpha / 255 is the pixel's weight.
    pub goal: Goal,
    /// Sum of the pixels' weights.
    pub total_weight: f64,
    /// Whether pixels may weigh less than 1; SSIM's windows are normalised then.
    pub masked: bool,
    /// Weight of its loss: 1 for real views, `alpha_k` for virtual ones.
    pub weight: f64,
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
            depths: None,
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
