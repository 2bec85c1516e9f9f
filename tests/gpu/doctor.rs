//! The doctor finds what is planted in the kernels, stage by stage, and says so.

use gspotential::doctor::changes::SetSize;
use gspotential::doctor::determinism::Repeat;
use gspotential::doctor::loss::{Kind, LossCase, MaskKind};
use gspotential::doctor::twin::cases::{cover, huge, random_scene};
use gspotential::doctor::view::{COVERS, ORDINARY, ViewCase};
use gspotential::doctor::{
    Adapter, Context, Finding, RasterizerReport, Report, changes, examine_exp2, examine_treatments,
    exchange, loss, marks, sorts, stage, view,
};
use gspotential::error::Result;
use gspotential::gpu::shader::{STAGES, compose};
use gspotential::gpu::{Gpu, Rasterizer};

use super::plants::{PLANTS, Plant};
use super::rig::context;

/// What the doctor finds with a slip in one kernel.
fn findings_with(plant: &Plant) -> Vec<Finding> {
    let sources = |stage: &str, degree: u32| {
        let source = compose(stage, degree);
        if stage != plant.stage {
            return source;
        }
        assert!(source.contains(plant.from), "{stage}: no `{}`", plant.from);
        source.replace(plant.from, plant.to)
    };
    // For the memory of this machine: the kernels are on an adapter of their own.
    let _alone = context();
    let gpu = Gpu::open().expect("an adapter");
    let ctx = Context::from_sources(gpu, plant.rasterizer(), &sources);
    findings(&ctx).expect("computes")
}

/// Every kernel once.
fn findings(ctx: &Context) -> Result<Vec<Finding>> {
    let view = ViewCase::new("ordinary", &random_scene(400, 2, 2), 1, (61, 47), ORDINARY);
    let mut findings = view::examine(ctx, &view)?.0.list;
    let view = ViewCase::new("cover", &cover(), 0, (331, 217), ORDINARY);
    findings.extend(view::examine(ctx, &view)?.0.list);
    let view = ViewCase::new("screen covers", &huge(60, 6), 0, (97, 63), COVERS);
    findings.extend(view::examine(ctx, &view)?.0.list);
    let view = view::dropout_case(&random_scene(400, 2, 9), 40, 1);
    findings.extend(view::examine(ctx, &view)?.0.list);
    for case in view::extreme_cases() {
        findings.extend(view::examine(ctx, &case)?.0.list);
    }
    findings.extend(sorts::examine(ctx, sorts::BLOCKS)?.list);
    findings.extend(examine_exp2(ctx)?.list);
    for mask in [None, Some(MaskKind::Any)] {
        for size in [(33, 17), loss::SEAMS] {
            let kind = Kind::Noise;
            findings.extend(loss::examine(ctx, &LossCase { size, kind, mask })?.list);
        }
    }
    for masked in [false, true] {
        findings.extend(marks::examine(ctx, (33, 17), masked)?.list);
    }
    findings.extend(examine_treatments(ctx)?);
    let plan = changes::random_plan(150, 333, 1);
    findings.extend(
        changes::examine_rearrange(
            ctx,
            &plan,
            SetSize {
                n: 150,
                stride: 180,
            },
            1,
        )?
        .list,
    );
    findings.extend(changes::examine_reset(ctx, 70)?.list);
    findings.extend(exchange::examine(ctx, (33, 17))?.list);
    Ok(findings)
}

#[test]
fn a_slip_in_any_kernel_is_found_and_named_first() {
    let mut unplanted: Vec<&str> = STAGES.iter().map(|(stage, _)| *stage).collect();
    for plant in &PLANTS {
        unplanted.retain(|stage| *stage != plant.stage);
        let findings = findings_with(plant);
        let failed = |f: &&Finding| !f.holds();
        let in_order = stage::ALL.iter();
        let first = in_order
            .flat_map(|stage| findings.iter().filter(|f| f.stage == *stage))
            .find(failed);
        let first = first.map(|f| f.stage);
        assert_eq!(first, Some(plant.noticed), "{}: {}", plant.stage, plant.to);
        let elsewhere = all_well()
            .into_iter()
            .filter(|f| plant.is_elsewhere(f.stage));
        let findings = findings.into_iter().chain(elsewhere).collect();
        let error = report(findings).verdict().expect_err("something failed");
        assert_eq!(error.exit_code(), 1);
        assert!(error.to_string().contains(plant.noticed), "{error}");
    }
    assert!(unplanted.is_empty(), "nothing planted in {unplanted:?}");
}

/// The report over these findings, were training to repeat.
fn report(findings: Vec<Finding>) -> Report {
    let of = |rasterizer| RasterizerReport {
        rasterizer,
        is_rule: rasterizer == Rasterizer::Thread,
        view_seconds: 1.0,
        repeat: Repeat {
            iterations: 1,
            n_gaussians: 1,
            hashes: ["0".into(), "0".into()],
            holds: true,
        },
    };
    let rasterizers = Rasterizer::ALL.map(of).to_vec();
    Report::new(Adapter::of(&context().gpu), rasterizers, findings, &[])
}

/// One finding a stage, all well.
fn all_well() -> Vec<Finding> {
    let finding = |stage: &&'static str| Finding {
        stage,
        case: "any".into(),
        what: "any".into(),
        error: 0.5,
        bound: 1.0,
    };
    stage::ALL.iter().map(finding).collect()
}

#[test]
fn a_report_passes_only_with_every_stage_compared_and_in_bounds() {
    report(all_well()).verdict().expect("all is well");
    for (i, stage) in stage::ALL.iter().enumerate() {
        let mut lacking = all_well();
        lacking.remove(i);
        let mut beyond = all_well();
        beyond[i].error = 1.5;
        let mut lost = all_well();
        lost[i].error = f64::INFINITY;
        for findings in [lacking, beyond, lost] {
            let report = report(findings);
            let error = report.verdict().expect_err("a stage failed").to_string();
            assert!(
                error.contains(&format!("out of bounds: {stage};")),
                "{error}"
            );
            let table = report.to_string();
            assert_eq!(table.matches("**FAILED**").count(), 1, "{table}");
        }
    }
    let mut differs = report(all_well());
    differs.rasterizers[1].repeat.holds = false;
    differs.holds = false;
    let error = differs.verdict().expect_err("training differs").to_string();
    assert!(error.contains("training twice"), "{error}");
}

#[test]
fn the_report_says_where_the_rule_is_wrong() {
    let mut report = report(all_well());
    assert!(!report.to_string().contains("The rule is wrong"));
    // A tenth is noise.
    report.rasterizers[1].view_seconds = 0.95;
    assert!(!report.to_string().contains("The rule is wrong"));
    report.rasterizers[1].view_seconds = 0.8;
    let text = report.to_string();
    assert!(
        text.contains("`workgroup` is faster than `thread`"),
        "{text}"
    );
    assert!(text.contains("--set render.rasterizer=workgroup"), "{text}");
    report
        .verdict()
        .expect("a wrong rule is no fault of the adapter");
}
