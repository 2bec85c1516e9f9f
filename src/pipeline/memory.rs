//! This module predicts what a run will need before it trains, by part and as tables.

use super::Prepared;
use crate::cloud::{splat, visibility, warp};
use crate::config::Config;
use crate::files::peak_host_bytes;
use crate::gaussians::Gaussians;
use crate::gpu::Gpu;
use crate::report::{Column, Table};
use crate::scene::{PointCloud, Prior, Scene, View};
use crate::train::{DepthTarget, TrainingBytes, TrainingView, generator_bytes};

/// Memory of a run, before it trains.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// GPU buffers at the start.
    pub gpu: TrainingBytes,
    /// The same once the set has grown as far as it may; `None` where nothing grows.
    pub gpu_at_most: Option<TrainingBytes>,
    /// What the process holds at most from beginning to end, bytes by part; no less than it has
    /// held so far.
    pub host: Vec<(&'static str, u64)>,
}

impl Forecast {
    /// Predicts training `prepared` as `config` says, whose cap on Gaussians the adapter can hold.
    pub fn new(gpu: &Gpu, scene: &Scene, prepared: &Prepared, config: &Config) -> Forecast {
        let Prepared {
            supervision, start, ..
        } = prepared;
        let goals =
            |views: &[TrainingView]| -> u64 { views.iter().map(|v| v.goal.bytes() as u64).sum() };
        let carved = prepared.carved.as_ref().map(|c| cloud_bytes(&c.cloud));
        let mut host = vec![
            ("the program and the driver", gpu.host_bytes_at_start()),
            ("training photographs", image_bytes(&scene.train)),
            ("their target images", goals(&supervision.real)),
            (
                "target images of the virtual views",
                goals(&supervision.virtual_views) + goals(&supervision.held_out),
            ),
            ("test photographs", image_bytes(&scene.test)),
            (
                "point cloud",
                cloud_bytes(&scene.cloud) + carved.unwrap_or(0),
            ),
            ("first Gaussians", gaussian_bytes(start)),
            ("its points, for a while", splatting_bytes(scene, config)),
        ];
        let depths = supervision.real.iter().filter_map(|v| v.depths.as_ref());
        let depths: usize = depths.map(DepthTarget::bytes).sum();
        let priors: usize = scene
            .train
            .iter()
            .filter_map(|v| v.prior.as_ref())
            .map(Prior::bytes)
            .sum();
        if depths + priors > 0 {
            host.push(("their depths and normals", (depths + priors) as u64));
        }
        let generator = generator_bytes(start.len(), config);
        if generator > 0 {
            host.push(("the network that makes the Gaussians", generator));
        }
        // A file with text or with observations may be larger than all that is made of it.
        let all: u64 = host.iter().map(|(_, bytes)| bytes).sum();
        let loaded = peak_host_bytes().unwrap_or(0);
        if loaded > all {
            host.push(("loading, beyond these", loaded - all));
        }
        Forecast {
            gpu: TrainingBytes::at_start(gpu, start.len(), supervision, config),
            gpu_at_most: TrainingBytes::at_most(gpu, start.len(), supervision, config),
            host,
        }
    }

    /// Returns the tables in Markdown.
    pub fn tables(&self) -> String {
        let mut text = format!(
            "{}\nRoom for pairs, {} bytes each, grows to half as many again as a view turns out to have.\n\n{}",
            gpu_memory_table(&self.gpu),
            self.gpu.bytes_a_pair(),
            host_memory_table(&self.host)
        );
        if let Some(most) = &self.gpu_at_most {
            text += &format!(
                "\nWith {} Gaussians, as many as there may be: about {} MiB of GPU buffers\n",
                most.n_gaussians,
                most.peak() >> 20
            );
        }
        text
    }
}

fn image_bytes(views: &[View]) -> u64 {
    let masks = |view: &View| view.mask.as_ref().map_or(0, |mask| mask.set.len());
    let bytes = views.iter().map(|view| view.image.rgb.len() + masks(view));
    bytes.sum::<usize>() as u64
}

fn cloud_bytes(cloud: &PointCloud) -> u64 {
    let confidence = cloud.confidence.as_deref().map_or(0, size_of_val);
    (size_of_val(&cloud.positions[..]) + size_of_val(&cloud.colors[..]) + confidence) as u64
}

/// Returns the bytes that preparation needs beside the cloud itself while it splats it, which is
/// more than loading does: a PLY's own bytes are gone by then.
fn splatting_bytes(scene: &Scene, config: &Config) -> u64 {
    let is_weighed = config.views.visibility.mask_angle_deg.is_some() && config.views.count > 0;
    let visibility = match is_weighed {
        true => visibility::bytes_a_point(scene.train.len()),
        false => 0,
    };
    let warp = match config.views.count {
        0 => 0,
        _ => warp::bytes_a_point(config.splat.colors),
    };
    (scene.cloud.len() * (splat::BYTES_A_POINT + visibility + warp)) as u64
}

fn gaussian_bytes(gaussians: &Gaussians) -> u64 {
    let Gaussians {
        means,
        scales_log,
        rotations_wxyz,
        opacity_logits,
        sh,
        ..
    } = gaussians;
    (size_of_val(&means[..])
        + size_of_val(&scales_log[..])
        + size_of_val(&rotations_wxyz[..])
        + size_of_val(&opacity_logits[..])
        + size_of_val(&sh[..])) as u64
}

const MEBIBYTES: Column = Column::number("mib", "MiB", 1);

/// Returns the GPU buffers of training as a table.
fn gpu_memory_table(bytes: &TrainingBytes) -> Table {
    let TrainingBytes {
        n_gaussians,
        n_pairs,
        model,
        moments,
        statistics,
        workspace,
        targets,
        poses,
        partner,
        depths,
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
    row(
        "target images of a step's two views",
        &pixels,
        workspace.goals,
    );
    if targets > 0 {
        row("target images that stay", "", targets);
    }
    if poses > 0 {
        row("gradients of poses", &gaussians, poses);
    }
    if depths > 0 {
        row("depths, normals and their gradient", "both", depths);
    }
    row("uniforms", "", workspace.uniforms);
    if partner > 0 {
        row("the partner's own of these", &gaussians, partner);
    }
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
fn host_memory_table(parts: &[(&str, u64)]) -> Table {
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
