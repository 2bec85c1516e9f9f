//! This module writes tables of where a run's time went.

use super::{Column, Table};
use crate::run::{RunProfile, Seconds, StepProfile};

/// Returns both tables of a run's profile, in Markdown.
pub fn profile_tables(profile: &RunProfile) -> String {
    let step = &profile.step;
    let kernels = if step.kernels.is_empty() {
        "No GPU times by kernel: the adapter has no timestamp queries, or there was no iteration after \
         the first\n"
            .to_owned()
    } else {
        format!(
            "GPU time by kernel, mean of {} of {} iterations, by timestamps\n\n{}",
            step.timed,
            step.iterations,
            kernel_table(step)
        )
    };
    let stages = stage_table(&profile.seconds);
    format!(
        "{kernels}\nWall-clock time by stage; those with a dash are parts of training\n\n{stages}"
    )
}

/// Returns an iteration's time by kernel as a table.
pub fn kernel_table(step: &StepProfile) -> Table {
    let columns = [
        Column::text("kernel", "kernel"),
        Column::number("step_ms", "ms a step", 3),
        Column::quantity("share", "share"),
        Column::number("dispatches", "dispatches", 1),
    ];
    let mut table = Table::new("kernels", &columns);
    let total = step.kernel_s();
    let ms = |seconds: f64| (1e3 * seconds).into();
    for kernel in &step.kernels {
        table.row([
            (&kernel.kernel).into(),
            ms(kernel.seconds),
            format!("{:.1} %", 100.0 * kernel.seconds / total).into(),
            kernel.dispatches.into(),
        ]);
    }
    let n: f64 = step.kernels.iter().map(|kernel| kernel.dispatches).sum();
    table.row(["all kernels".into(), ms(total), "100 %".into(), n.into()]);
    table.row(["an iteration, wall clock".into(), ms(step.wall_s)]);
    table
}

fn stage_table(seconds: &Seconds) -> Table {
    let columns = [
        Column::text("stage", "stage"),
        Column::number("seconds", "seconds", 3),
    ];
    let mut table = Table::new("stage-seconds", &columns);
    for (stage, s) in [
        ("adapter", seconds.open),
        ("loading", seconds.load),
        ("focus and field", seconds.field),
        ("carving", seconds.carve),
        ("virtual cameras", seconds.sample),
        ("splatting", seconds.splat),
        ("first Gaussians", seconds.gaussians),
        ("files and checksums", seconds.files),
        ("pipelines", seconds.compile),
        ("buffers and upload", seconds.upload),
        (
            "**from the command to the first iteration**",
            seconds.to_first_iteration,
        ),
        ("training", seconds.train),
        ("- the first iteration", seconds.first_iteration),
        ("- densification, pruning, resets", seconds.densify),
        ("- checkpoints", seconds.checkpoints),
        ("writing the model", seconds.write),
        ("evaluation", seconds.eval),
        ("report", seconds.report),
    ] {
        if s.is_some() {
            table.row([stage.into(), s.into()]);
        }
    }
    table
}
