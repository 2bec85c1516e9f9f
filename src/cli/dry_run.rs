//! This module writes what `train --dry-run` prints.

use crate::pipeline::DryRun;
use crate::report::{Column, Table, agreement_table};
use crate::terminal::progress::short_time;

/// Returns as a table what a run would take.
pub(crate) fn text(dry: &DryRun) -> String {
    let columns = [Column::text("what", ""), Column::text("value", "value")];
    let mut table = Table::new("dry-run", &columns);
    let mut row = |what: &str, value: String| table.row([what.into(), value.into()]);
    let mebibytes = |bytes: u64| format!("{} MiB", bytes >> 20);
    let [width, height] = dry.image_size;
    row("scene", dry.scene.clone());
    let training = format!("{} of {width}x{height}", dry.n_training_views);
    row("training views", training);
    row("test views", dry.n_test_views.to_string());
    row("virtual views", dry.n_virtual_views.to_string());
    row("points", dry.n_points.to_string());
    row("Gaussians at the start", dry.n_gaussians.to_string());
    let most = dry.max_gaussians.map(|n| n.to_string());
    row("Gaussians at most", most.unwrap_or("the same".to_owned()));
    row("GPU buffers so far", mebibytes(dry.gpu_bytes));
    let host = dry.host_bytes.map_or("n/a".to_owned(), mebibytes);
    row("process so far", host);
    row("preparation", short_time(dry.prepare_s));
    row("an iteration", format!("{:.1} ms", 1e3 * dry.iteration_s));
    let all = f64::from(dry.n_iterations) * dry.iteration_s;
    let most = if dry.may_end { "at most " } else { "" };
    let iterations = format!("{most}{} iterations", dry.n_iterations);
    row(&iterations, short_time(all));
    format!(
        "{table}\n{}\nMeasured over the first iterations; time and memory grow with the Gaussians and with the \
         degree of their colours.\n\nPredicted for training:\n\n{}",
        agreement_table(&dry.agreement),
        dry.memory.tables()
    )
}
