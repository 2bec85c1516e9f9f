//! Every key is declared here: its type, its default, what it may be and what it means.
//!
//! Lengths are relative to the sphere radius `R`. The defaults are the preset `paper`.

use super::declare::{
    above_to, any, at_least, between, choice, from_below, odd_window, positive, section, within,
    zero_or,
};
use super::{
    FloatersConfig, GeneratorConfig, NeedConfig, PartnerConfig, PriorConfig, UnpoolConfig,
};

/// The most that a `u32` holds.
const U32: f64 = u32::MAX as f64;

section! {
    /// Everything that decides a training run. Lengths are relative to the sphere radius `R`.
    struct Config {
        /// The preset this config started from.
        preset: String = "paper".to_owned(), any();
        /// Seeds every random choice.
        seed: u64 = 0, any();
        /// Training iterations, with `need.ends` the most; each renders one real and, with virtual views,
        /// one virtual view.
        iterations: u32 = 10_000, within(1.0, 1e8);
        /// What is loaded.
        scene: SceneConfig = SceneConfig::default(), any();
        /// Points that the photographs contradict go before anything is made of the cloud.
        carve: CarveConfig = CarveConfig::default(), any();
        /// The camera potential field.
        field: FieldConfig = FieldConfig::default(), any();
        /// Virtual views.
        views: ViewsConfig = ViewsConfig::default(), any();
        /// Point splatting of the cloud into the virtual views.
        splat: SplatConfig = SplatConfig::default(), any();
        /// How views are rendered.
        render: RenderConfig = RenderConfig::default(), any();
        /// The Gaussians at the start.
        model: ModelConfig = ModelConfig::default(), any();
        /// Large Gaussians on a sphere beyond the scene: a background that lives in the file.
        shell: ShellConfig = ShellConfig::default(), any();
        /// The image losses.
        loss: LossConfig = LossConfig::default(), any();
        /// Depths and normals that training views are held to.
        prior: PriorConfig = PriorConfig::default(), any();
        /// Dropout of Gaussians in training.
        dropout: DropoutConfig = DropoutConfig::default(), any();
        /// A second set of Gaussians that is trained beside the first.
        partner: PartnerConfig = PartnerConfig::default(), any();
        /// A network that makes the Gaussians.
        generator: GeneratorConfig = GeneratorConfig::default(), any();
        /// Refinement of the training cameras' poses.
        poses: PosesConfig = PosesConfig::default(), any();
        /// Adam with 3DGS's learning rates.
        optimizer: OptimizerConfig = OptimizerConfig::default(), any();
        /// 3DGS's densification and pruning.
        densify: DensifyConfig = DensifyConfig::default(), any();
        /// Unpooling: growth towards neighbours that are far away.
        unpool: UnpoolConfig = UnpoolConfig::default(), any();
        /// Pruning of what floats before the surfaces.
        floaters: FloatersConfig = FloatersConfig::default(), any();
        /// Coverage-aware pruning and densification.
        coverage: CoverageConfig = CoverageConfig::default(), any();
        /// What is chosen for the scene while it trains.
        need: NeedConfig = NeedConfig::default(), any();
    }
}

section! {
    /// What is loaded.
    struct SceneConfig {
        /// Images wider than this are scaled down to it.
        max_width_px: u32 = 1600, within(1.0, 65_535.0);
        /// Bounds the longer side instead; null: the width is bounded.
        max_size_px: Option<u32> = None, within(1.0, 65_535.0);
        /// Number of training views if there is no split file. They lie uniformly over the sorted
        /// names, both ends among them, or around the loop if the sequence closes (its last camera is
        /// a neighbour of its first).
        n_train: usize = 4, within(1.0, 1e6);
        /// Greatest number of test views if there is no split file, uniformly among the others.
        n_test: usize = 60, within(0.0, 1e6);
        /// The cloud is thinned to this many points before it becomes Gaussians; null: to the number
        /// of training pixels divided by `pixels_a_point`.
        max_points: Option<usize> = None, within(1.0, U32);
        /// Training pixels for each Gaussian at the start, where `max_points` is null.
        pixels_a_point: f64 = 1.0, within(0.01, 1e6);
        /// What training makes of the pixels that a photograph's mask leaves out.
        outside_mask: OutsideMask = OutsideMask::Auto, any();
    }
}

choice! {
    /// What the pixels are that a mask leaves out.
    enum OutsideMask {
        /// `background` for an alpha channel, `ignored` for a file in `masks/`.
        Auto = "auto",
        /// They do not count: training learns nothing from them.
        Ignored = "ignored",
        /// They show `model.background`, in test views, too: the subject stands free. Points of the
        /// cloud that a training view has outside its mask go, and there are no far shell and no
        /// filled holes.
        Background = "background",
        /// The photograph's: masks count in evaluation alone.
        Kept = "kept",
    }
}

section! {
    /// Carving: points that the photographs contradict go before anything is made of the cloud.
    struct CarveConfig {
        /// Carves the cloud, which is taken as it is without.
        enabled: bool = false, any();
        /// A point goes if its colour lies further than this, in [0, 1], outside the range of the
        /// photograph's window.
        threshold: f64 = 0.2, within(0.0, 1.0);
        /// Side of the window, pixels, odd.
        window_px: u32 = 5, odd_window();
        /// A point is seen through a gap, and not judged, if another close by is nearer by more than
        /// this share of its depth.
        depth_tolerance: f64 = 0.05, between(0.0, 1.0);
        /// Greatest number of rounds; a round without a point to remove is the last.
        max_rounds: u32 = 20, within(1.0, 1000.0);
        /// The round that would bring the removed share of the cloud above this does not happen.
        max_share: f64 = 0.5, between(0.0, 1.0);
    }
}

section! {
    /// The camera potential field.
    struct FieldConfig {
        /// How a training camera's influence decays with the angle to it.
        kernel: Kernel = Kernel::Sech, any().paper("Eq. 2");
        /// Sharpness of the kernel: `sigma` of sech, where arcsech(0.01) = 5.298292365610484 leaves
        /// 1 % at 90 degrees, or `kappa` of von Mises-Fisher, where ln(100) = 4.605 does.
        sigma: f64 = 5.298292365610484, positive().paper("sigma, Eq. 2");
        /// `lambda`, weight of `U_conf` in `U_total`.
        lambda: f64 = 0.2, at_least(0.0).paper("lambda, Eq. 4");
        /// Candidate directions on the Fibonacci sphere.
        n_candidates: usize = 4096, within(1.0, 1e6);
    }
}

choice! {
    /// Kernel of the information potential, 1 at its peak; `theta` is the angle to the camera.
    enum Kernel {
        /// `sech(sigma (1 - cos theta))`, the paper's.
        Sech = "sech",
        /// `exp(sigma (cos theta - 1))`; the paper compares it at `kappa` 3.0 and 4.4.
        VonMisesFisher = "von_mises_fisher",
    }
}

section! {
    /// Virtual views.
    struct ViewsConfig {
        /// `K`, number of virtual views; 0 trains without them.
        count: usize = 256, within(0.0, 1e6).paper("K");
        /// How they are chosen.
        strategy: Strategy = Strategy::Potential, any().paper("Eq. 6");
        /// `epsilon` of the sampling weights `1 / (U_total + epsilon)` and `theta_min + epsilon`.
        epsilon: f64 = 1e-3, positive().paper("epsilon, Eq. 5");
        /// As few are taken of the draw, `count` at most, as leave one candidate in twenty farther than this from all of them; null: `count`. It does not apply
        /// to interpolation, and where cameras look outward.
        within_deg: Option<f64> = None, positive().unit("degrees");
        /// The geometry-aware choice of virtual views.
        visibility: VisibilityConfig = VisibilityConfig::default(), any();
    }
}

choice! {
    /// How virtual views are chosen, by the names of the paper's table of sampling strategies. All
    /// but interpolation choose among the same candidates on the sphere, without replacement.
    enum Strategy {
        /// CPF, the paper's: drawn with weight `1 / (U_total + epsilon)`.
        Potential = "potential",
        /// Nearest-angle random: drawn with weight `theta_min + epsilon`, the angle to the nearest
        /// training camera in place of the potential.
        NearestAngle = "nearest_angle",
        /// Uniform sphere: drawn with equal weights.
        SphereUniform = "sphere_uniform",
        /// Farthest-point sphere: one after another, the candidate farthest from the training
        /// cameras and from those chosen before.
        SphereFarthest = "sphere_farthest",
        /// Uniform interpolation: between two training cameras, any pair and any place between
        /// alike, on an arc around the focus.
        Interpolation = "interpolation",
    }
}

section! {
    /// The geometry-aware choice of virtual views. Each candidate's weight is multiplied by
    /// `s^power`, where `s` is the share of its covered pixels whose point some training camera sees
    /// from a direction within `max_angle_deg` of the candidate's.
    struct VisibilityConfig {
        /// Weighs the candidates so; without it weights are the strategy's own.
        enabled: bool = false, any();
        /// Greatest angle at the point between the directions to the candidate and to the training
        /// camera.
        max_angle_deg: f64 = 60.0, above_to(0.0, 180.0);
        /// Power of the share that multiplies a weight; 0 only drops candidates.
        power: f64 = 2.0, within(0.0, 16.0);
        /// Candidates with a lower share are dropped.
        min_share: f64 = 0.25, within(0.0, 1.0);
        /// A training camera sees a point that lies at most this share of the depth behind the
        /// nearest one in its pixel.
        depth_tolerance: f64 = 0.05, between(0.0, 1.0);
        /// Pixels of the virtual views whose point no training camera sees from within this angle,
        /// whatever `enabled` says, count as holes; null: none does.
        mask_angle_deg: Option<f64> = None, above_to(0.0, 180.0);
    }
}

/// Least radius of a disc, pixels: half a pixel's diagonal and a little, so that a disc holds the
/// centre of the pixel that its own centre lies in.
pub const MIN_DISC_RADIUS_PX: f64 = 0.708;

section! {
    /// Point splatting of the cloud into the virtual views.
    struct SplatConfig {
        /// What a point covers.
        footprint: Footprint = Footprint::Disc, any();
        /// Greatest radius of a disc; the least is 0.708. The footprint `pixel` ignores it.
        max_radius_px: f64 = 4.0, within(MIN_DISC_RADIUS_PX, 64.0);
        /// Discs that lie at most this share of the depth behind the nearest one in a pixel blend with
        /// it; those farther back are hidden. The footprint `pixel` ignores it.
        depth_tolerance: f64 = 0.02, within(0.0, 1.0);
        /// Side of the connectivity filter's window, pixels, odd.
        filter_window_px: u32 = 5, odd_window();
        /// Pixels with fewer valid neighbours in the window are removed; 0 switches the filter off.
        filter_min_neighbors: u32 = 2, within(0.0, 3968.0).unit("pixels");
        /// What colours the covered pixels of the virtual views: the `points` of the cloud; the
        /// `photographs`, warped by the cloud's depth, where one sees the surface; or a `blend` of both by the
        /// errors that each has at the photographs, which also weighs the pixels. The last two want discs.
        colors: ColorSource = ColorSource::Points, any();
        /// Virtual views of a subject that is cut out of the photographs show the background beyond the visual hull of the
        /// masks (Laurentini 1994), and pixels at the splat's rim do not count; a random background leaves them as they are.
        outline: bool = false, any();
    }
}

choice! {
    /// What colours a virtual view.
    enum ColorSource {
        /// The points of the cloud.
        Points = "points",
        /// The photographs, by the eighth power of the cosine between rays; the points where none sees
        /// the surface.
        Photographs = "photographs",
        /// Both by the inverse of the variances that they have at photographs which are left out; pixels
        /// whose expected error is large weigh less.
        Blend = "blend",
    }
}

choice! {
    /// What a splatted point covers.
    enum Footprint {
        /// The pixel that it falls into; points behind a surface show through its gaps.
        Pixel = "pixel",
        /// A disc as large as its source pixel, with a visibility pass: surface splatting.
        Disc = "disc",
    }
}

section! {
    /// How views are rendered.
    struct RenderConfig {
        /// What rasterizes a tile: a `thread`, for drivers that run on a CPU, or a `workgroup`, for GPUs and for as many
        /// Gaussians and pixels as the small tiles of a `thread` have no room for; `auto` is the one for the adapter, the images' size and
        /// the cloud, and a run's `config.json` says which that was.
        rasterizer: RasterizerChoice = RasterizerChoice::Auto, any();
        /// Whose 2^x the rasterizers take: the program's `polynomial`, or that of the `adapter` where a check at the
        /// start finds it within 2 units in the last place; `auto` is the one for the adapter, and a run's `config.json`
        /// says which that was.
        exp2: Exp2Choice = Exp2Choice::Auto, any();
        /// Target images stay on the adapter up to this much, the photographs' first; the others are
        /// unpacked and uploaded when it is their turn. null: 2048 on a GPU, 0 on a driver that runs on
        /// a CPU.
        targets_mib: Option<u32> = None, within(0.0, U32);
    }
}

choice! {
    /// How the rasterizers share an image out among the adapter's threads. Images are the same;
    /// gradients are summed up in another order, so that trainings differ in their last bits.
    enum RasterizerChoice {
        /// `thread` on a driver that runs on a CPU, as long as it has room, `workgroup` on a GPU; a run's `config.json` says
        /// which of them it was.
        Auto = "auto",
        /// One thread a tile of 4x8 pixels.
        Thread = "thread",
        /// One workgroup of 64 threads a tile of 16x16 pixels.
        Workgroup = "workgroup",
    }
}

choice! {
    /// Whose 2^x the rasterizers take; trainings differ in their last bits.
    enum Exp2Choice {
        /// `polynomial` on a driver that runs on a CPU, `adapter` on a GPU; a run's `config.json` says
        /// which of them it was.
        Auto = "auto",
        /// The program's own, the same on every adapter.
        Polynomial = "polynomial",
        /// The adapter's, a third of the forward rasterizer's instructions less; the polynomial where the adapter's is off by
        /// more than 2 units in the last place.
        Adapter = "adapter",
    }
}

section! {
    /// The Gaussians at the start.
    struct ModelConfig {
        /// What the first Gaussians are made of.
        start: Start = Start::Cloud, any();
        /// Highest spherical-harmonics degree, 0 to 3.
        sh_degree: u32 = 3, within(0.0, 3.0);
        /// The active degree rises by one every so many iterations.
        sh_interval: u32 = 1000, within(1.0, U32).unit("iterations");
        /// Opacity of every Gaussian at the start.
        initial_opacity: f64 = 0.1, between(0.0, 1.0);
        /// Near plane, as a share of the scene's extent: `R`, or twice the median distance of the training
        /// cameras from the focus where that is less, so that a camera far away clips nothing of the others'.
        near: f64 = 0.01, between(0.0, 1.0);
        /// Background colour of renders, RGB in [0, 1].
        background: [f64; 3] = [0.0; 3], within(0.0, 1.0);
    }
}

choice! {
    /// What the first Gaussians are made of.
    enum Start {
        /// The points of the cloud.
        Cloud = "cloud",
        /// The visual hull of the photographs' masks (GaussianObject, Yang et al. 2024).
        Hull = "hull",
    }
}

section! {
    /// The far shell: large Gaussians on a sphere beyond the scene, a background that lives in the
    /// file.
    struct ShellConfig {
        /// Number of Gaussians, some hundreds: the more, the finer; 0: no shell.
        count: usize = 0, zero_or(100.0, 1e6);
        /// Distance from the focus, in `R`; more if the cloud reaches farther.
        radius: f64 = 10.0, within(2.0, 1e6).unit("R");
    }
}

section! {
    /// The image losses.
    struct LossConfig {
        /// `L = (1 - w) L1 + w (1 - SSIM)`.
        ssim_weight: f64 = 0.2, within(0.0, 1.0);
        /// Multiplies `alpha_k` of every virtual view.
        virtual_weight: f64 = 1.0, at_least(0.0).paper("Eq. 9");
        /// That weight falls in proportion where there are more training views than these: the more the photographs show, the less
        /// a splat knows that they do not; 0: it stays.
        virtual_photographs: usize = 0, zero_or(1.0, 1e6);
        /// Weighs virtual views by `alpha_k = 1 / (1 + U_conf)`; without it `alpha_k` is 1.
        confidence_weighting: bool = true, any().paper("alpha_k, Eq. 8");
        /// Weight of a virtual view's pixels that no point covers, against 1 of those that one does;
        /// their colour is that of what lies behind, around them. Rounded to a multiple of 1/255; 0: ignored, as the
        /// paper does.
        fill_weight: f64 = 0.0, within(0.0, 1.0);
        /// Weight of a second L1 loss, the mean over the farthest twentieth of a photograph's pixels, by the
        /// depth of the cloud's nearest point in each (D2GS, Song et al. 2026).
        far_weight: f64 = 0.0, at_least(0.0);
        /// Weight of the mean binary cross-entropy between a render's opacity and the mask of a photograph
        /// whose subject is cut out (GaussianObject, Yang et al. 2024); others have none.
        silhouette_weight: f64 = 0.0, at_least(0.0);
        /// Weight of the mean least scale, in `R`, of the Gaussians, those that the photograph does not show counted as 0: they
        /// become flat (PGSR, Chen et al. 2024; SparseSurf, Gu et al. 2026).
        flat_weight: f64 = 0.0, at_least(0.0);
        /// Renders have a background colour drawn anew in each iteration instead of `model.background`, and so has a
        /// photograph around a cut-out subject: no gap between Gaussians can pass for that colour.
        random_background: bool = false, any();
    }
}

section! {
    /// Dropout of Gaussians in training.
    struct DropoutConfig {
        /// Probability at the start.
        rate_start: f64 = 0.0, from_below(0.0, 1.0);
        /// Probability at the end, which it reaches linearly. In every iteration each Gaussian is left
        /// out of both views' renders with this probability, and the opacity of the others is
        /// divided by one less it (DropGaussian, Park et al. 2025). The file needs no correction.
        rate_end: f64 = 0.0, from_below(0.0, 1.0);
        /// Above 0 here or below, each Gaussian has a share of its own in that probability: this times
        /// its nearness to the camera, 0 to 1, and, all of it, times 0.7 and 0.3 in the middle and far
        /// third; the others keep their opacity (D2GS, Song et al. 2026).
        depth_weight: f64 = 0.0, within(0.0, 1.0);
        /// Adds to that share this times how crowded the Gaussian is, 0 to 1, by the mean distance to its six nearest others.
        density_weight: f64 = 0.0, within(0.0, 1.0);
    }
}

impl LossConfig {
    /// Returns what multiplies `alpha_k` of a virtual view beside so many training views.
    pub fn virtual_weight_beside(&self, n_train: usize) -> f64 {
        match self.virtual_photographs {
            0 => self.virtual_weight,
            most => self.virtual_weight * most as f64 / most.max(n_train) as f64,
        }
    }
}

impl DropoutConfig {
    /// Says whether Gaussians have shares of their own.
    pub fn is_guided(&self) -> bool {
        self.depth_weight > 0.0 || self.density_weight > 0.0
    }
}

section! {
    /// Refinement of the training cameras' poses with the Gaussians. The field and the virtual views are
    /// those of the poses before; these views and the cloud hold the frame.
    struct PosesConfig {
        /// Refines the poses, which stay as the scene has them without.
        refine: bool = false, any();
        /// Learning rate of a camera's turn about its centre at the start, radians.
        turn_lr: f64 = 2e-3, within(0.0, 0.1).unit("radians");
        /// Learning rate of a camera's shift at the start, in `R`.
        shift_lr: f64 = 5e-4, within(0.0, 0.1).unit("R");
        /// Share of both that is left at the end; in between they fall exponentially.
        rate_left: f64 = 0.01, within(1e-6, 1.0);
    }
}

section! {
    /// Adam with 3DGS's learning rates.
    struct OptimizerConfig {
        /// Learning rate of positions at the start, times the camera extent.
        mean_lr_start: f64 = 1.6e-4, positive().unit("camera extents");
        /// Learning rate of positions at the end; in between it falls exponentially.
        mean_lr_end: f64 = 1.6e-6, positive().unit("camera extents");
        /// The rate of a position is multiplied by 1 plus this times `1 - sigmoid(c)`, `c` the confidence
        /// of its point of the cloud, above 1 as DUSt3R has it (InstantSplat, Fan et al. 2024); Gaussians
        /// that come of others have theirs. 0: all positions have the same rate.
        confidence_gain: f64 = 0.0, at_least(0.0);
        /// Learning rate of colours of degree 0; higher degrees take a twentieth.
        sh_lr: f64 = 2.5e-3, at_least(0.0);
        /// Learning rate of opacity logits.
        opacity_lr: f64 = 0.05, at_least(0.0);
        /// Learning rate of the scales' logarithms.
        scale_lr: f64 = 5e-3, at_least(0.0);
        /// Learning rate of rotations.
        rotation_lr: f64 = 1e-3, at_least(0.0);
        /// Adam's decay of the mean gradient.
        beta1: f64 = 0.9, from_below(0.0, 1.0);
        /// Adam's decay of the mean squared gradient.
        beta2: f64 = 0.999, from_below(0.0, 1.0);
        /// Adam's epsilon.
        epsilon: f64 = 1e-15, positive();
    }
}

section! {
    /// 3DGS's densification and pruning.
    struct DensifyConfig {
        /// Clones and splits Gaussians, whose number only falls without.
        enabled: bool = true, any();
        /// Densification follows iterations after this one.
        start: u32 = 500, any().unit("iterations");
        /// Densification precedes this iteration, the run's last at most: what it adds is trained.
        end: u32 = 6000, any().unit("iterations");
        /// Iterations between two densifications.
        interval: u32 = 100, within(1.0, U32).unit("iterations");
        /// Mean norm of the position gradient on screen (normalised device coordinates) above which
        /// a Gaussian is cloned or split. Coverage-aware densification replaces it.
        gradient_threshold: f64 = 2e-4, positive();
        /// Split above this scale, clone below, in camera extents.
        split_scale: f64 = 0.01, positive().unit("camera extents");
        /// Prune below this opacity.
        min_opacity: f64 = 0.005, within(0.0, 1.0);
        /// Prune above this scale, in camera extents, once opacities have been reset. Halves of a split
        /// Gaussian are judged by their own scale.
        max_scale: f64 = 0.1, positive().unit("camera extents");
        /// Prune Gaussians that were wider than this on a training image, as a share of its longer
        /// side, once opacities have been reset. null: none, as 3DGS's code does, which clears the
        /// widths before it looks at them.
        max_screen: Option<f64> = None, positive();
        /// Opacities are reset every so many iterations.
        opacity_reset_interval: u32 = 3000, within(1.0, U32).unit("iterations");
        /// Opacities are not reset after this iteration.
        opacity_reset_end: u32 = 6000, any().unit("iterations");
        /// Gaussians that lie apart from all others go every so many iterations while it densifies
        /// (GaussianObject, Yang et al. 2024); null: none.
        outlier_interval: Option<u32> = None, within(1.0, U32).unit("iterations");
        /// Gaussians are not cloned, split or unpooled beyond this number.
        max_gaussians: usize = 5_000_000, within(1.0, U32);
    }
}

section! {
    /// Coverage-aware pruning and densification.
    struct CoverageConfig {
        /// `Q_i`-guided anisotropy pruning.
        prune: bool = true, any().paper("Eq. 13");
        /// `Q_i`-guided densification threshold.
        densify: bool = true, any().paper("Eq. 15");
        /// First iteration after which `Q_i` guides the pruning and the densification threshold.
        start: u32 = 1000, any().unit("iterations");
        /// Iterations between two prunings.
        interval: u32 = 100, within(1.0, U32).unit("iterations");
        /// `tau_min`, greatest anisotropy where nothing is covered.
        tau_min: f64 = 20.0, at_least(1.0).paper("tau_min, Eq. 12");
        /// `tau_max`, greatest anisotropy where coverage is best.
        tau_max: f64 = 100.0, at_least(1.0).paper("tau_max, Eq. 12");
        /// `delta_min`, densification threshold where coverage is best.
        delta_min: f64 = 2e-4, positive().paper("delta_min, Eq. 14");
        /// `delta_max`, densification threshold where nothing is covered.
        delta_max: f64 = 8e-4, positive().paper("delta_max, Eq. 14");
        /// `epsilon` of the anisotropy, in `R`.
        anisotropy_epsilon: f64 = 1e-7, positive().unit("R").paper("epsilon, Eq. 11");
        /// Greatest share of the Gaussians that is pruned in one step, the worst first.
        max_pruned_share: f64 = 0.05, within(0.0, 1.0);
    }
}
