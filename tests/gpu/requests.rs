//! What a step asks of the GPU: passes, dispatches, writes and pipelines.

use gspotential::config::Config;
use gspotential::doctor::twin::cases::{cameras, random_scene};
use gspotential::doctor::{gaussians_of, view_of};
use gspotential::gpu::{Commands, Gpu, Rasterizer, Requests};
use gspotential::render::{Kernels, Targets};
use gspotential::train::{Supervision, Trainer, train};

use super::rig::context;
use crate::hard::specimens::{config, noise_supervision};

/// The noise of the specimens, once as the photograph and once as a virtual view.
fn supervision() -> Supervision {
    let mut supervision = noise_supervision(&cameras()[0]);
    supervision.virtual_views = supervision.real.clone();
    supervision
}

fn kept(mib: u32) -> Config {
    let mut config = config(3);
    config.render.targets_mib = Some(mib);
    config
}

/// What a step asks that comes after `done` others.
fn requests_of_a_step(gpu: &Gpu, kernels: &Kernels, config: &Config, done: u32) -> Requests {
    let start = gaussians_of(&random_scene(300, 1, 50).gaussians, 1);
    let supervision = supervision();
    let trainer = Trainer::new(gpu, kernels, &start, &supervision, config);
    let mut trainer = trainer.expect("fits");
    trainer.step(0, None);
    let before = gpu.requests();
    trainer.step(done, None);
    gpu.wait().expect("no fault");
    let after = gpu.requests();
    Requests {
        passes: after.passes - before.passes,
        dispatches: after.dispatches - before.dispatches,
        writes: after.writes - before.writes,
    }
}

#[test]
fn a_step_opens_few_passes_and_writes_little() {
    let gpu = &context().gpu;
    // Lists are short here: each scan of counts is one dispatch.
    for (rasterizer, dispatches) in [(Rasterizer::Thread, 100), (Rasterizer::Workgroup, 48)] {
        let kernels = Kernels::with(rasterizer);
        let resident = requests_of_a_step(gpu, &kernels, &kept(1), 1);
        assert_eq!(resident.passes, 1);
        assert_eq!(resident.dispatches, dispatches, "{rasterizer}");
        // Uniforms and loss of two views, and Adam's.
        assert_eq!(resident.writes, 5);
        let uploaded = requests_of_a_step(gpu, &kernels, &kept(0), 1);
        assert_eq!(uploaded.writes, 7, "two target images more");
        assert_eq!(uploaded.dispatches, resident.dispatches);
        // The loss is sampled after the last step, and its parts are summed up in two dispatches a view.
        let last = requests_of_a_step(gpu, &kernels, &kept(1), 2);
        assert_eq!(last.dispatches, resident.dispatches + 4);
    }
}

#[test]
fn targets_that_stay_change_no_bit() {
    let ctx = context();
    let start = gaussians_of(&random_scene(300, 1, 50).gaussians, 1);
    let trained = [0, 1].map(|mib| {
        let supervision = supervision();
        let config = kept(mib);
        let result = train(
            &ctx.gpu,
            &ctx.kernels,
            &start,
            &supervision,
            &config,
            &mut (),
        );
        result.expect("trains")
    });
    assert!(trained[0].gaussians == trained[1].gaussians);
    assert_eq!(trained[0].samples, trained[1].samples);
}

#[test]
fn as_many_targets_stay_as_the_budget_holds() {
    let view = view_of(&cameras()[0]);
    let one = Targets::bytes(&[view], u64::MAX);
    let (row, rows) = (4 * view.padded_size().0, view.size[1] as usize);
    assert_eq!(one, 4 * (row * rows) as u64);
    for (budget, n) in [
        (0, 0),
        (one - 1, 0),
        (one, 1),
        (3 * one - 1, 2),
        (9 * one, 3),
    ] {
        assert_eq!(Targets::bytes(&[view; 3], budget), n * one, "{budget}");
    }
    let mut gpu = Gpu::open().expect("an adapter");
    gpu.info.device_type = wgpu::DeviceType::Cpu;
    assert_eq!(Targets::budget(None, &gpu), 0);
    assert_eq!(Targets::budget(Some(7), &gpu), 7 << 20);
    gpu.info.device_type = wgpu::DeviceType::DiscreteGpu;
    assert_eq!(Targets::budget(None, &gpu), 2048 << 20);
}

#[test]
fn pipelines_are_compiled_when_they_are_dispatched() {
    let ctx = context();
    let source = gspotential::gpu::shader::compose("reset_opacity", 0);
    let stage = gspotential::gpu::Stage::new("reset_opacity", source);
    let [used, unused] = [0, 1].map(|_| stage.kernel("reset_opacity"));
    let buffers = ["reset", "geometry", "first_moment", "second_moment"];
    let made = buffers.map(|name| match name {
        "reset" => gspotential::gpu::Buffer::uniform::<[f32; 4]>(&ctx.gpu, name),
        _ => gspotential::gpu::Buffer::storage::<[f32; 4]>(&ctx.gpu, name, 64).expect("fits"),
    });
    let named: Vec<_> = buffers.into_iter().zip(&made).collect();
    let group = used.bind(&ctx.gpu, &named);
    unused.bind(&ctx.gpu, &named);
    let mut commands = Commands::new(&ctx.gpu);
    commands.dispatch(&used, &group, 64);
    assert!(!used.is_compiled());
    commands.compile();
    assert!(used.is_compiled());
    commands.submit();
    assert!(!unused.is_compiled());
}

#[test]
fn kernels_prepared_beforehand_are_those_of_the_first_step_and_train_the_same() {
    let gpu = &context().gpu;
    let start = gaussians_of(&random_scene(300, 1, 50).gaussians, 1);
    for rasterizer in Rasterizer::ALL {
        let [plain, prepared] = [0, 1].map(|_| Kernels::with(rasterizer));
        prepared.prepare(gpu);
        assert!(prepared.of_first_step().iter().all(|k| k.is_compiled()));
        gpu.wait().expect("no fault");
        let trained = [&plain, &prepared].map(|kernels| {
            let supervision = supervision();
            let trained = train(gpu, kernels, &start, &supervision, &kept(0), &mut ());
            trained.expect("trains")
        });
        // All that was prepared is used.
        assert!(plain.of_first_step().iter().all(|k| k.is_compiled()));
        assert!(trained[0].gaussians == trained[1].gaussians, "{rasterizer}");
    }
}
