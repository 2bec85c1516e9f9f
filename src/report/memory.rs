//! This module writes what a run will need, by part.

use super::{Column, Table};
use crate::train::TrainingBytes;

const MEBIBYTES: Column = Column::number("mib", "MiB", 1);

/// Returns the GPU buffers of training as a table.
pub fn gpu_memory_table(bytes: &TrainingBytes) -> Table {
    let TrainingBytes {
        n_gaussians,
        n_pairs,
        model,
        moments,
        statistics,
        workspace,
        poses,
        reading,
        densifying,
    } = *bytes;
    let gaussians = format!("{n_gaussians} Gaussians");
    let pairs = format!("{n_pairs} pairs of a view");
    let pixels = "pixels of the largest view".to_owned();
    let columns = [
        Column::text("buffers", "GPU buffers"),
        Column::text("for", "for"),
        MEBIBYTES,
    ];
    let mut table = Table::new("gpu-memory", &columns);
    let mut row = |what: &str, of: &str, bytes: u64| {
        table.row([what.into(), of.into(), mebibytes(bytes).into()]);
    };
    row("Gaussians", &gaussians, model);
    row("Adam's moments", &gaussians, moments);
    row("gradients", &gaussians, workspace.gradients);
    row("densification's statistics", &gaussians, statistics);
    row("projected Gaussians", &gaussians, workspace.splats);
    row("(tile, Gaussian) pairs", &pairs, workspace.pairs);
    row("gradients of pairs", &pairs, workspace.pair_gradients);
    row("sorting", "both", workspace.sorts);
    row("render", &pixels, workspace.image);
    row("loss and its gradient", &pixels, workspace.loss);
    row("goals of a step's two views", &pixels, workspace.goals);
    if poses > 0 {
        row("gradients of poses", &gaussians, poses);
    }
    row("uniforms", "", workspace.uniforms);
    if densifying > reading {
        row(
            "densifying: the new set beside the old",
            &gaussians,
            densifying,
        );
    } else {
        row("reading back", &gaussians, reading);
    }
    row("**all, at the worst moment**", "", bytes.peak());
    table
}

/// Returns as a table what the process holds from beginning to end.
pub fn host_memory_table(parts: &[(&str, u64)]) -> Table {
    let mut table = Table::new(
        "host-memory",
        &[Column::text("part", "host memory"), MEBIBYTES],
    );
    for (what, bytes) in parts {
        table.row([(*what).into(), mebibytes(*bytes).into()]);
    }
    let all = parts.iter().map(|(_, bytes)| bytes).sum();
    table.row([
        "**all, from beginning to end**".into(),
        mebibytes(all).into(),
    ]);
    table
}

fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}
