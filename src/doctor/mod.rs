//! Checks that this program computes on an adapter what it should: it holds every kernel to the f64
//! [`crate::doctor::twin`], measures how long each takes, and sees whether training repeats to the
//! bit.
//!
//! Each stage of a view works on what the stage before it left on the GPU, as in training, and is
//! held to the reference's own result from the stored parameters on; sorts, sums and lists, which
//! are integers, agree exactly with what the host makes of the same input.

mod adapter;
mod bounds;
mod depth_losses;
mod finding;
mod rig;
mod table;

pub mod adam;
pub mod changes;
pub mod depth;
pub mod determinism;
pub mod exchange;
pub mod forward;
pub mod host;
pub mod image;
pub mod loss;
pub mod marks;
pub mod pose;
pub mod sorts;
pub mod stage;
pub mod timing;
pub mod twin;
pub mod view;

pub use adapter::{Adapter, Limit, STORAGE_BUFFERS, UNIFORM_BUFFERS, WORKGROUP_BYTES};
pub use finding::{Finding, Findings};
pub use host::{SplatCase, examine_splat};
pub use rig::{
    Context, POISON, Rig, ViewGradients, camera_of, gaussians_of, twin_of, view_of, wide,
};

use serde::Serialize;

use self::changes::SetSize;
use self::determinism::Repeat;
use self::loss::{Kind, LossCase, MaskKind};
use self::timing::Timing;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::gpu::{Exp2, Gpu, Rasterizer, exp2};
use crate::version::VERSION;

/// The doctor's findings on an adapter, and its verdict.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// This program's version.
    pub version: &'static str,
    /// The adapter that was examined.
    pub adapter: Adapter,
    /// Every stage of `stage::ALL`, in that order.
    pub stages: Vec<StageReport>,
    /// Each rasterizer: one training run twice, and what an iteration takes.
    pub rasterizers: Vec<RasterizerReport>,
    /// Whether all is well.
    pub holds: bool,
    /// Every comparison.
    pub findings: Vec<Finding>,
}

/// One rasterizer: how long a view takes with it, and whether training repeats.
#[derive(Clone, Debug, Serialize)]
pub struct RasterizerReport {
    /// Which one.
    pub rasterizer: Rasterizer,
    /// Whether it is the one that the rule gives this adapter.
    pub is_rule: bool,
    /// What all stages of the timed view take, forward and backward.
    pub view_seconds: f64,
    /// One training with it, run twice.
    pub repeat: Repeat,
}

/// One stage over all its cases.
#[derive(Clone, Debug, Serialize)]
pub struct StageReport {
    /// Name of the stage, one of those in `stage::ALL`.
    pub stage: &'static str,
    /// How many of `unit` were timed; 0 if none were.
    pub count: usize,
    /// The things that `count` counts.
    pub unit: &'static str,
    /// Time that all of them took, seconds; NaN if none were timed.
    pub seconds: f64,
    /// Whether `seconds` is by the adapter's timestamps; otherwise it is wall-clock time.
    pub by_timestamps: bool,
    /// The finding that comes closest to its bound or exceeds it most; `None`: nothing was
    /// compared, which does not pass.
    pub worst: Option<Finding>,
    /// Comparisons made.
    pub n_findings: usize,
    /// Whether something was compared and all of it is in bounds.
    pub holds: bool,
}

/// Runs every stage on `gpu`, compares and takes the time: the fastest of so many rounds, at least one.
///
/// # Errors
/// An adapter that lacks what the kernels need, or a GPU fault.
pub fn examine(gpu: Gpu, rounds: u32) -> Result<Report> {
    let adapter = Adapter::of(&gpu);
    if let Some(limit) = adapter.limits.iter().find(|limit| !limit.holds()) {
        return Err(Error::new(format!(
            "the adapter has {} {}, the kernels need {}",
            limit.adapter, limit.name, limit.needed
        ))
        .at(&adapter.name)
        .way_out("update its driver, or use another adapter"));
    }
    let mut ctx = Context::new(gpu)?;
    let config = Config::preset("paper")?;
    let mut findings = examine_kernels(&ctx)?;
    let mut timings = timing::time_rest(&ctx, rounds)?;
    let by_rule = ctx.kernels.rasterizer;
    let others = Rasterizer::ALL
        .into_iter()
        .filter(|other| *other != by_rule);
    let mut rasterizers = Vec::new();
    for rasterizer in [by_rule].into_iter().chain(others) {
        if rasterizer != ctx.kernels.rasterizer {
            ctx = ctx.with_rasterizer(rasterizer);
            findings.extend(examine_views(&ctx)?);
            findings.extend(examine_losses(&ctx)?);
        }
        for case in view::large_cases() {
            findings.extend(view::examine(&ctx, &case)?.0.list);
        }
        let timed = view::timed_case();
        findings.extend(view::examine(&ctx, &timed)?.0.list);
        let (own, view_seconds) = timing::time_view(&ctx, &timed, rounds)?;
        let (losses, loss_seconds) = timing::time_losses(&ctx, rounds)?;
        timings.extend(losses);
        // Stages that all rasterizers share are timed once, with the rule's.
        let is_new = |t: &Timing| timings.iter().all(|known: &Timing| known.stage != t.stage);
        let own: Vec<Timing> = own.into_iter().filter(is_new).collect();
        timings.extend(own);
        rasterizers.push(RasterizerReport {
            rasterizer,
            is_rule: rasterizer == by_rule,
            view_seconds: view_seconds + loss_seconds,
            repeat: determinism::repeat(&ctx)?,
        });
    }
    for (found, timing) in [
        host::examine_field(&config),
        host::examine_point_splat(&config)?,
    ] {
        findings.extend(found.list);
        timings.push(timing);
    }
    Ok(Report::new(adapter, rasterizers, findings, &timings))
}

/// Checks every stage of small views, and a sort of many entries, with the context's rasterizer.
///
/// # Errors
/// A GPU fault.
pub fn examine_views(ctx: &Context) -> Result<Vec<Finding>> {
    let mut findings = Vec::new();
    for case in view::small_cases().iter().chain(&view::extreme_cases()) {
        findings.extend(view::examine(ctx, case)?.0.list);
    }
    findings.extend(sorts::examine(ctx, sorts::BLOCKS)?.list);
    Ok(findings)
}

/// Holds 2^x, as the rasterizers take it, to exact powers; errors and bounds are units in the last place.
///
/// # Errors
/// A GPU fault.
pub fn examine_exp2(ctx: &Context) -> Result<Findings> {
    let mut findings = Findings::of(match ctx.exp2 {
        Exp2::Polynomial => "polynomial",
        Exp2::Adapter => "the adapter's own",
    });
    let ulps = exp2::worst_ulps(&ctx.gpu, &ctx.powers)?;
    findings.add((stage::EXP2, "ulp"), ulps, exp2::MOST_ULPS);
    Ok(findings)
}

/// Holds the image losses to the reference, with the context's rasterizer.
///
/// # Errors
/// A GPU fault.
pub fn examine_losses(ctx: &Context) -> Result<Vec<Finding>> {
    let mut findings = Vec::new();
    for case in loss_cases() {
        findings.extend(loss::examine(ctx, &case)?.list);
    }
    for masked in [false, true] {
        findings.extend(marks::examine(ctx, (33, 17), masked)?.list);
    }
    findings.extend(loss::examine_residual(ctx, loss::LARGE)?.list);
    Ok(findings)
}

/// Holds every kernel to the reference on small cases.
///
/// # Errors
/// A GPU fault.
pub fn examine_kernels(ctx: &Context) -> Result<Vec<Finding>> {
    let mut findings = examine_views(ctx)?;
    findings.extend(examine_exp2(ctx)?.list);
    findings.extend(examine_losses(ctx)?);
    for degree in 0..4 {
        for n_views in [1, 2] {
            findings.extend(adam::examine(ctx, degree, n_views, adam::Treatment::ALIKE)?.list);
        }
        // Fewer, within the room that there is, and more.
        for len in [40, 170, 333] {
            let plan = changes::random_plan(150, len, 96);
            let set = SetSize {
                n: 150,
                stride: 180,
            };
            findings.extend(changes::examine_rearrange(ctx, &plan, set, degree)?.list);
        }
    }
    findings.extend(examine_treatments(ctx)?);
    findings.extend(changes::examine_reset(ctx, 70)?.list);
    for size in [(33, 17), (64, 48)] {
        findings.extend(exchange::examine(ctx, size)?.list);
    }
    Ok(findings)
}

/// Holds steps to the reference that treat Gaussians unlike one another.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn examine_treatments(ctx: &Context) -> Result<Vec<Finding>> {
    let frozen = adam::Treatment {
        frozen_beyond: adam::FROZEN_BEYOND,
        ..adam::Treatment::ALIKE
    };
    let own_rates = adam::Treatment {
        own_rates: true,
        ..adam::Treatment::ALIKE
    };
    let flattened = adam::Treatment {
        flat_weight: adam::FLAT_WEIGHT,
        ..adam::Treatment::ALIKE
    };
    let mut findings = adam::examine(ctx, 1, 2, frozen)?.list;
    findings.extend(adam::examine(ctx, 0, 1, flattened)?.list);
    findings.extend(adam::examine(ctx, 1, 1, own_rates)?.list);
    Ok(findings)
}

fn loss_cases() -> Vec<LossCase> {
    let mut cases = Vec::new();
    for size in [(64, 48), (33, 17), (7, 5), (1, 1)] {
        let mut add = |kind, mask| cases.push(LossCase { size, kind, mask });
        add(Kind::Noise, None);
        add(Kind::Flat, None);
        for mask in MaskKind::ALL {
            add(Kind::Noise, Some(mask));
        }
    }
    for (kind, mask) in [
        (Kind::Noise, None),
        (Kind::Flat, None),
        (Kind::Noise, Some(MaskKind::Half)),
        (Kind::Flat, Some(MaskKind::Any)),
        (Kind::Off, None),
        (Kind::Off, Some(MaskKind::Half)),
        (Kind::Off, Some(MaskKind::Hole)),
    ] {
        let size = loss::SEAMS;
        cases.push(LossCase { size, kind, mask });
    }
    cases
}

impl StageReport {
    fn of(stage: &'static str, findings: &[Finding], timings: &[Timing]) -> StageReport {
        let own: Vec<&Finding> = findings.iter().filter(|f| f.stage == stage).collect();
        let worst = own
            .iter()
            .copied()
            .max_by(|a, b| a.severity().total_cmp(&b.severity()));
        let timing = timings.iter().find(|timing| timing.stage == stage);
        StageReport {
            stage,
            count: timing.map_or(0, |t| t.count),
            unit: timing.map_or("", |t| t.unit),
            seconds: timing.map_or(f64::NAN, |t| t.seconds),
            by_timestamps: timing.is_some_and(|t| t.by_timestamps),
            worst: worst.cloned(),
            n_findings: own.len(),
            holds: !own.is_empty() && own.iter().all(|finding| finding.holds()),
        }
    }
}

impl Report {
    /// Sums up what was found, stage by stage, in a verdict.
    pub fn new(
        adapter: Adapter,
        rasterizers: Vec<RasterizerReport>,
        findings: Vec<Finding>,
        timings: &[Timing],
    ) -> Report {
        let stages: Vec<StageReport> = stage::ALL
            .iter()
            .map(|stage| StageReport::of(stage, &findings, timings))
            .collect();
        Report {
            version: VERSION,
            adapter,
            holds: rasterizers.iter().all(|r| r.repeat.holds)
                && stages.iter().all(|stage| stage.holds),
            stages,
            rasterizers,
            findings,
        }
    }

    /// Turns the verdict into a result.
    ///
    /// # Errors
    /// Something is out of bounds: names the stages.
    pub fn verdict(&self) -> Result<()> {
        if self.holds {
            return Ok(());
        }
        let what = format!("out of bounds: {}", self.failures().join(", "));
        let way_out = "do not trust results of this adapter; update its driver or use another";
        Err(Error::new(what).at(&self.adapter.name).way_out(way_out))
    }

    /// Returns the stages that are out of bounds, and training if it does not repeat.
    fn failures(&self) -> Vec<&str> {
        let stages = self.stages.iter().filter(|stage| !stage.holds);
        let mut failures: Vec<&str> = stages.map(|stage| stage.stage).collect();
        if self.rasterizers.iter().any(|r| !r.repeat.holds) {
            failures.push("training twice");
        }
        failures
    }
}
