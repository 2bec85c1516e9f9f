//! Devices that are lost, memory that runs out, commands that are not valid.

use std::path::Path;
use std::thread;

use gspotential::error::{ErrorKind, Result};
use gspotential::eval::{EvalOptions, render_views};
use gspotential::gpu::{Buffer, Gpu};
use gspotential::pipeline::{self, GoOn, TrainJob};
use gspotential::render::{Device, Kernels, Model};
use gspotential::run::{Evaluation, RunDir, Stop};

use super::{Outcome, job, wait_until};
use crate::gpu::rig::context;

/// Trains into `root`; `fault` is let loose on the adapter once there is a checkpoint.
fn train_with(root: &Path, fault: impl FnOnce(&Gpu) + Send) -> Result<Evaluation> {
    let gpu = Gpu::open()?;
    let job = TrainJob {
        checkpoint_every: Some(4),
        ..job()
    };
    let scene = job.load()?;
    let run = RunDir::create(root, &job.config, false)?;
    let first = root.join("checkpoints/0000000004.ckpt");
    thread::scope(|scope| {
        scope.spawn(|| {
            wait_until("there is a checkpoint", || first.exists());
            fault(&gpu);
        });
        pipeline::train(
            &gpu,
            &scene,
            &job,
            Default::default(),
            &EvalOptions::default(),
            &run,
            &Stop::unheard(),
        )
    })
}

/// What the training comes to on its own.
fn undisturbed(root: &Path) -> Outcome {
    train_with(root, |_| {}).expect("trains");
    Outcome::of(root)
}

#[test]
fn a_lost_device_is_opened_again_and_the_run_ends_as_if_nothing_had_been() {
    let _alone = context();
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("run");
    let mut was_lost = false;
    let trained = train_with(&root, |gpu| {
        gpu.device.destroy();
        was_lost = true;
    });
    trained.expect("trains the second time");
    assert!(was_lost);
    assert!(Outcome::of(&root) == undisturbed(&folder.path().join("other")));
}

#[test]
fn memory_that_runs_out_is_named_with_sizes_and_the_run_goes_on_from_its_checkpoint() {
    let _alone = context();
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("run");
    let error = train_with(&root, |gpu| gpu.limit_memory(1 << 20)).expect_err("a fault");
    let text = error.to_string();
    assert_eq!(error.exit_code(), 1);
    for part in [
        "buffer `",
        " MiB",
        "out of GPU memory with ",
        "--max-points",
    ] {
        assert!(text.contains(part), "no `{part}` in: {text}");
    }
    assert!(!root.join("metrics.json").exists());
    let resumed =
        TrainJob::resume(&root, GoOn::default(), &EvalOptions::default()).expect("trains");
    assert!(resumed.evaluation.is_some());
    assert!(Outcome::of(&root) == undisturbed(&folder.path().join("other")));
}

#[test]
fn a_lost_device_is_an_error_wherever_it_is_met() {
    let _alone = context();
    let gpu = Gpu::open().expect("an adapter");
    let kernels = Kernels::new(&gpu);
    let job = job();
    let scene = job.load().expect("a scene");
    let prepared =
        pipeline::prepare(&scene, &job.config, &mut Default::default()).expect("a sphere");
    let buffer = Buffer::storage_from(&gpu, "four", &[1_u32; 4]).expect("fits");
    gpu.device.destroy();
    let config = &job.config.model;
    let (frame, views) = (&prepared.frame, &scene.test);
    let model = Model::upload(&gpu, &prepared.start, prepared.start.len());
    let outcomes = [
        gpu.wait(),
        buffer.read::<u32>(&gpu, 4).map(drop),
        gpu.check(),
        model.and_then(|model| model.download(&gpu)).map(drop),
        render_views(
            Device {
                gpu: &gpu,
                kernels: &kernels,
            },
            &prepared.start,
            frame,
            views,
            config,
            |_, _| Ok(()),
        ),
    ];
    for (i, outcome) in outcomes.into_iter().enumerate() {
        let error = outcome.err().unwrap_or_else(|| panic!("{i}: no error"));
        assert_eq!(error.kind(), ErrorKind::DeviceLost, "{i}: {error}");
        assert!(
            error.to_string().contains("the GPU is lost"),
            "{i}: {error}"
        );
    }
}

#[test]
fn a_command_that_is_not_valid_is_an_error_at_the_next_wait() {
    let ctx = context();
    let oversized = wgpu::BufferDescriptor {
        label: Some("oversized"),
        size: ctx.gpu.limits.max_buffer_size + 4,
        usage: wgpu::BufferUsages::STORAGE,
        mapped_at_creation: false,
    };
    let _unusable = ctx.gpu.device.create_buffer(&oversized);
    let error = ctx.gpu.wait().expect_err("a fault").to_string();
    assert!(
        error.contains("GPU fault") && error.contains("oversized"),
        "{error}"
    );
    ctx.gpu.wait().expect("it is told once");
}
