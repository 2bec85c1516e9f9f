//! The policy decides which Gaussians come and go: 3DGS's densification and pruning, and the
//! paper's coverage-aware rules. It decides on the host from what the GPU has gathered;
//! [`super::optimizer`] applies it.

use glam::{DMat3, DQuat, DVec3, Vec3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::record::PlanCounts;
use super::schedule;
use crate::config::Config;
use crate::field::Coverage;
use crate::gpu::shader_count;

/// Random stream of the split positions, apart from those of other consumers of the seed.
const STREAM: u64 = 0x7370_6c69_7400_0000;

/// Marks a planned Gaussian that is new and starts without Adam moments. No index reaches it: a
/// Gaussian takes at least 48 bytes of a buffer of less than 2^32.
pub const NEW: u32 = 1 << 31;

/// 3DGS: each half of a split Gaussian is smaller by 0.8 times their number.
const SPLIT_SHRINK: f64 = 1.6;

/// All that the policy looks at, one entry a Gaussian; canonical frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gathered {
    /// Centres.
    pub means: Vec<Vec3>,
    /// `ln(opacity / (1 - opacity))`.
    pub opacity_logits: Vec<f32>,
    /// Natural logarithms of the standard deviations along the principal axes.
    pub scales_log: Vec<Vec3>,
    /// Quaternions, w first, not normalised.
    pub rotations_wxyz: Vec<[f32; 4]>,
    /// Sum of the screen gradient's norm, number of views drawn in, largest radius (share of the
    /// longer image side) since the last densification.
    pub statistics: Vec<[f32; 3]>,
}

/// The new set: Gaussian `i` is Gaussian `sources[i]` (with [`NEW`] set where it is an addition),
/// its mean moved by `changes[i].xyz` and its log scales by `changes[i].w`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// The old Gaussian that each new one comes from; [`NEW`] may be set beside the index.
    pub sources: Vec<u32>,
    /// What is added: x, y, z to the mean, w to each log scale.
    pub changes: Vec<[f32; 4]>,
    /// Gaussians touched, by reason.
    pub counts: PlanCounts,
}

/// What happens to one Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Keep,
    Clone,
    Split,
    Prune(Reason),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reason {
    Opacity,
    Size,
    Anisotropy,
}

/// A Gaussian's fate, the score by which it is chosen where not all can be, and the fate of those
/// that are not.
#[derive(Clone, Copy, Debug)]
struct Judgement {
    fate: Fate,
    score: f64,
    otherwise: Fate,
}

impl Judgement {
    fn of(fate: Fate) -> Judgement {
        Judgement {
            fate,
            score: 0.0,
            otherwise: fate,
        }
    }
}

/// The scene's part in the decision, in the canonical frame.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings<'a> {
    /// The coverage scores `Q_i` of the training cameras, which the coverage-aware rules go by.
    pub coverage: &'a Coverage,
    /// 3DGS's camera extent.
    pub extent: f64,
    /// Gaussians farther from the focus are kept as they are: those of the far shell.
    pub frozen_beyond: f32,
    /// Which of two sets it is, each of which draws for itself: 0 or 1.
    pub set: u64,
}

/// Decides after `done` iterations.
pub fn plan(
    gathered: &Gathered,
    config: &Config,
    surroundings: &Surroundings<'_>,
    done: u32,
) -> Plan {
    let rules = Rules {
        config,
        surroundings,
        done,
    };
    let mut fates: Vec<Judgement> = (0..gathered.means.len())
        .into_par_iter()
        .map(|i| rules.judge(gathered, i))
        .collect();
    let n = gathered.means.len();
    let n_elongated = (config.coverage.max_pruned_share * n as f64) as usize;
    limit(
        &mut fates,
        |fate| fate == Fate::Prune(Reason::Anisotropy),
        n_elongated,
    );
    let n_pruned = fates
        .iter()
        .filter(|judgement| matches!(judgement.fate, Fate::Prune(_)))
        .count();
    let room = config.densify.max_gaussians.saturating_sub(n - n_pruned);
    limit(
        &mut fates,
        |fate| matches!(fate, Fate::Clone | Fate::Split),
        room,
    );
    carry_out(gathered, &fates, config.seed, (surroundings.set, done))
}

/// Keeps only the `n` entries of the selected kind that have the highest scores (the lower index
/// of equals); the others meet their other fate.
fn limit(fates: &mut [Judgement], selects: impl Fn(Fate) -> bool, n: usize) {
    let mut chosen: Vec<usize> = (0..fates.len())
        .filter(|&i| selects(fates[i].fate))
        .collect();
    if chosen.len() <= n {
        return;
    }
    chosen.sort_by(|&a, &b| {
        let (a_score, b_score) = (fates[a].score, fates[b].score);
        b_score.total_cmp(&a_score).then(a.cmp(&b))
    });
    for &i in &chosen[n..] {
        fates[i].fate = fates[i].otherwise;
    }
}

struct Rules<'a> {
    config: &'a Config,
    surroundings: &'a Surroundings<'a>,
    done: u32,
}

impl Rules<'_> {
    fn judge(&self, gathered: &Gathered, i: usize) -> Judgement {
        let Rules {
            config,
            surroundings,
            done,
        } = *self;
        let Surroundings {
            coverage,
            extent,
            frozen_beyond,
            ..
        } = *surroundings;
        let mean = gathered.means[i];
        if mean.length() > frozen_beyond {
            return Judgement::of(Fate::Keep);
        }
        let densify = &config.densify;
        let densifies = schedule::densifies(config, done);
        let scale = gathered.scales_log[i].as_dvec3().exp();
        let [gradient_sum, n_views, radius] = gathered.statistics[i].map(f64::from);
        // Paper: a_i = max(s) / (min(s) + eps), tau_i between tau_min and tau_max by Norm(Q_i).
        let rules = &config.coverage;
        let anisotropy = scale.max_element() / (scale.min_element() + rules.anisotropy_epsilon);
        let norm_q = coverage.norm_q(coverage.q(mean.as_dvec3()));
        let tau = rules.tau_min + (rules.tau_max - rules.tau_min) * norm_q;

        // 3DGS prunes what densification leaves: halves by their own scale.
        let pruned_for_size = |shrink: f64| {
            let is_large = scale.max_element() / shrink > densify.max_scale * extent;
            let is_wide = densify.max_screen.is_some_and(|share| radius > share);
            densifies && done > densify.opacity_reset_interval && (is_large || is_wide)
        };
        let kept = if pruned_for_size(1.0) {
            Fate::Prune(Reason::Size)
        } else {
            Fate::Keep
        };
        let opacity = 1.0 / (1.0 + (-f64::from(gathered.opacity_logits[i])).exp());
        if densifies && opacity < densify.min_opacity {
            return Judgement::of(Fate::Prune(Reason::Opacity));
        }
        if schedule::prunes_by_coverage(config, done) && anisotropy > tau {
            return Judgement {
                fate: Fate::Prune(Reason::Anisotropy),
                score: anisotropy / tau,
                otherwise: kept,
            };
        }
        if densifies && n_views > 0.0 {
            let aware = rules.densify && done >= rules.start;
            let threshold = if aware {
                rules.delta_min + (rules.delta_max - rules.delta_min) * (1.0 - norm_q)
            } else {
                densify.gradient_threshold
            };
            let gradient = gradient_sum / n_views;
            if gradient >= threshold && !(aware && anisotropy > tau) {
                let small = scale.max_element() <= densify.split_scale * extent;
                let (fate, shrink) = if small {
                    (Fate::Clone, 1.0)
                } else {
                    (Fate::Split, SPLIT_SHRINK)
                };
                if !pruned_for_size(shrink) {
                    return Judgement {
                        fate,
                        score: gradient / threshold,
                        otherwise: kept,
                    };
                }
            }
        }
        Judgement::of(kept)
    }
}

/// Writes the plan: kept Gaussians first, in order; then the clones; then the halves of the split
/// ones (3DGS).
fn carry_out(gathered: &Gathered, fates: &[Judgement], seed: u64, (set, done): (u64, u32)) -> Plan {
    let mut plan = Plan::default();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((STREAM ^ (set << 63)) | u64::from(done));
    for (i, judgement) in fates.iter().enumerate() {
        match judgement.fate {
            Fate::Keep | Fate::Clone => plan.push(i, 0, DVec3::ZERO, 0.0),
            Fate::Prune(Reason::Opacity) => plan.counts.pruned_opacity += 1,
            Fate::Prune(Reason::Size) => plan.counts.pruned_size += 1,
            Fate::Prune(Reason::Anisotropy) => plan.counts.pruned_anisotropy += 1,
            Fate::Split => {}
        }
    }
    for (i, _) in fates
        .iter()
        .enumerate()
        .filter(|(_, judgement)| judgement.fate == Fate::Clone)
    {
        plan.push(i, NEW, DVec3::ZERO, 0.0);
        plan.counts.cloned += 1;
    }
    for (i, _) in fates
        .iter()
        .enumerate()
        .filter(|(_, judgement)| judgement.fate == Fate::Split)
    {
        let [w, x, y, z] = gathered.rotations_wxyz[i].map(f64::from);
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let scale = gathered.scales_log[i].as_dvec3().exp();
        for _ in 0..2 {
            let offset = rotation * (scale * standard_normal(&mut rng));
            plan.push(i, NEW, offset, -SPLIT_SHRINK.ln());
        }
        plan.counts.split += 1;
    }
    plan
}

impl Plan {
    /// Keeps the Gaussians that stay, as they are; `counts` says why the others go.
    pub fn of_those_that_stay(stays: &[bool], counts: PlanCounts) -> Plan {
        let sources = (0..stays.len()).filter(|&i| stays[i]).map(shader_count);
        let sources: Vec<u32> = sources.collect();
        Plan {
            changes: vec![[0.0; 4]; sources.len()],
            sources,
            counts,
        }
    }

    fn push(&mut self, source: usize, flag: u32, offset: DVec3, scale_change: f64) {
        self.sources.push(shader_count(source) | flag);
        let offset = offset.as_vec3();
        self.changes
            .push([offset.x, offset.y, offset.z, scale_change as f32]);
    }
}

fn standard_normal(rng: &mut ChaCha8Rng) -> DVec3 {
    let mut draw = || StandardNormal.sample(rng);
    DVec3::new(draw(), draw(), draw())
}
