//! The doctor finds what is planted in the kernels, stage by stage, and says so.

use gspotential::doctor::changes::SetSize;
use gspotential::doctor::determinism::Repeat;
use gspotential::doctor::loss::{Kind, LossCase, MaskKind};
use gspotential::doctor::twin::cases::{cover, huge, random_scene};
use gspotential::doctor::view::{COVERS, ORDINARY, ViewCase};
use gspotential::doctor::{Adapter, Context, Finding, Report, adam, changes, loss, stage, view};
use gspotential::error::Result;
use gspotential::gpu::Gpu;
use gspotential::gpu::shader::{STAGES, compose};

use super::rig::context;

/// What is replaced in a stage's complete source, and the stages that must notice it, the first
/// of them first.
struct Plant {
    stage: &'static str,
    from: &'static str,
    to: &'static str,
    noticed: &'static str,
}

const fn plant(
    stage: &'static str,
    from: &'static str,
    to: &'static str,
    noticed: &'static str,
) -> Plant {
    Plant {
        stage,
        from,
        to,
        noticed,
    }
}

/// Slips of the kind that happens: a constant, a sign, an index.
const PLANTS: [Plant; 36] = [
    plant(
        "project",
        "+ DILATION;",
        "+ 1.001 * DILATION;",
        stage::PROJECT,
    ),
    plant("project", "* 277803737u;", "* 277803735u;", stage::PROJECT),
    plant(
        "project",
        "max(bitcast<u32>(abs(distance)), least)",
        "max(bitcast<u32>(abs(distance)) & 0xfffff000u, least)",
        stage::PROJECT,
    ),
    plant(
        "project",
        "select(middle + size, middle - size,",
        "select(middle - size, middle + size,",
        stage::PROJECT,
    ),
    plant(
        "project",
        "return Double(sum, b - opaque(sum - a));",
        "return Double(sum, vec3f(0.0));",
        stage::PROJECT,
    ),
    plant(
        "project",
        " - view.center_low",
        " + view.center_low",
        stage::RASTERIZE,
    ),
    plant(
        "project",
        "shear = exact_shear(g, o, r);",
        "shear = r.hi.x - (b / cov_yy) * r.hi.y;",
        stage::RASTERIZE,
    ),
    plant(
        "project_backward",
        "return Double(sum, b - opaque(sum - a));",
        "return Double(sum, vec3f(0.5));",
        stage::PROJECT_BACKWARD,
    ),
    plant(
        "radix",
        "counters += one(digits.x);\n        if",
        "counters += one(digits.x ^ 1u);\n        if",
        stage::RADIX_SORT,
    ),
    plant(
        "bin",
        "floor(o.anchor.x + right",
        "floor(o.anchor.x + 0.5 * right",
        stage::BIN,
    ),
    plant(
        "scan",
        "counts[i / 4u] = vec4u(sum, y, z, w);",
        "counts[i / 4u] = vec4u(sum, y, z, w + c.w);",
        stage::SCAN,
    ),
    plant(
        "tile_ranges",
        "tile_ranges[before].end = i;",
        "tile_ranges[before].end = i - 1u;",
        stage::TILE_RANGES,
    ),
    plant(
        "tile_ranges",
        "tile_ranges[before].end = n;",
        "tile_ranges[before].end = n - 1u;",
        stage::TILE_RANGES,
    ),
    plant(
        "tile_ranges",
        "other == length && i < thread.local",
        "other == length && i > thread.local",
        stage::TILE_ORDER,
    ),
    plant(
        "rasterize",
        "raw >= vec4f(ALPHA_MIN)",
        "raw >= vec4f(2.0 * ALPHA_MIN)",
        stage::RASTERIZE,
    ),
    plant(
        "ssim",
        "(var_both + SSIM_C2)",
        "(var_both + 1.01 * SSIM_C2)",
        stage::LOSS,
    ),
    plant(
        "ssim",
        "* (1.0 / LEVEL_MAX);\n    let weight = select(masked,",
        "* (1.0 / LEVEL_MAX);\n    let weight = select(ceil(masked),",
        stage::MASKED_LOSS,
    ),
    plant("ssim", "+ row_e * (residual - of_row);", ";", stage::LOSS),
    plant(
        "ssim",
        "about.x + mean_e,",
        "1.0001 * about.x + mean_e,",
        stage::LOSS,
    ),
    plant(
        "loss_sum",
        "loss.mean_scale * sum.yx",
        "1.0001 * loss.mean_scale * sum.yx",
        stage::LOSS,
    ),
    plant(
        "rasterize_backward",
        "sum_xy += row_x * t_y;",
        "sum_xy += row_v * t_y;",
        stage::RASTERIZE_BACKWARD,
    ),
    plant(
        "bin",
        "last = splat_pairs[index + 1u];",
        "last = splat_pairs[index];",
        stage::BIN,
    ),
    plant(
        "sum_pairs",
        "i < PAIR_BLOCK; i++",
        "i < PAIR_BLOCK - 1u; i++",
        stage::SUM_PAIRS,
    ),
    plant(
        "sum_pairs",
        "first + size - 1u]",
        "first + size / 2u]",
        stage::SUM_PAIRS,
    ),
    plant(
        "project_backward",
        "left >= PAIR_BLOCK)",
        "left > PAIR_BLOCK / 2u)",
        stage::PROJECT_BACKWARD,
    ),
    plant(
        "project_backward",
        "d.v * (1.0 - kept_share(view) * s.opacity)",
        "d.v * s.opacity",
        stage::PROJECT_BACKWARD,
    ),
    plant(
        "project_backward",
        "1.0 - kept_share(view) * s.opacity",
        "1.0 - s.opacity",
        stage::PROJECT_BACKWARD,
    ),
    plant(
        "pose_backward",
        "d_mean -= color_to_mean",
        "d_mean += color_to_mean",
        stage::POSE_BACKWARD,
    ),
    plant(
        "pose_backward",
        "+ 0.5 * torque",
        "+ torque",
        stage::POSE_BACKWARD,
    ),
    plant(
        "pose_backward",
        "shifts[0] * w)",
        "w * shifts[0])",
        stage::POSE_BACKWARD,
    ),
    plant(
        "adam",
        "step.new_share_2 * (gradient * gradient)",
        "step.new_share_1 * (gradient * gradient)",
        stage::ADAM,
    ),
    plant(
        "adam",
        "vec4f(0.0), frozen)",
        "vec4f(0.0), frozen && plane > 0u)",
        stage::ADAM,
    ),
    plant("adam", " - step.views[0].center_low", "", stage::ADAM),
    plant(
        "rearrange",
        "new_planes[plane * rearrange.new_stride + id]",
        "new_planes[plane * rearrange.old_stride + id]",
        stage::REARRANGE,
    ),
    plant(
        "reset_opacity",
        "> reset.frozen_beyond",
        "> 1.1 * reset.frozen_beyond",
        stage::RESET_OPACITY,
    ),
    plant(
        "reset_opacity",
        "second_moment[id].w = 0.0;",
        "second_moment[id].x = 0.0;",
        stage::RESET_OPACITY,
    ),
];

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
    let ctx = Context::from_sources(gpu, &sources).expect("compiles");
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
    for mask in [None, Some(MaskKind::Any)] {
        let (size, kind) = ((33, 17), Kind::Noise);
        findings.extend(loss::examine(ctx, &LossCase { size, kind, mask })?.list);
    }
    findings.extend(adam::examine(ctx, 1, 2, adam::FROZEN_BEYOND)?.list);
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
        let error = report(findings).verdict().expect_err("something failed");
        assert_eq!(error.exit_code(), 1);
        assert!(error.to_string().contains(plant.noticed), "{error}");
    }
    assert!(unplanted.is_empty(), "nothing planted in {unplanted:?}");
}

/// The report over these findings, were training to repeat.
fn report(findings: Vec<Finding>) -> Report {
    let repeat = Repeat {
        iterations: 1,
        n_gaussians: 1,
        hashes: ["0".into(), "0".into()],
        holds: true,
    };
    Report::new(Adapter::of(&context().gpu), repeat, findings, &[])
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
    differs.repeat.holds = false;
    differs.holds = false;
    let error = differs.verdict().expect_err("training differs").to_string();
    assert!(error.contains("training twice"), "{error}");
}
