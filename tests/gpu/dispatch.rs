//! Dispatches and buffers at the adapter's limits.

use gspotential::doctor::twin::cases::{cameras, random_scene};
use gspotential::doctor::{Context, gaussians_of, view_of};
use gspotential::gpu::commands::fold;
use gspotential::gpu::shader::compose;
use gspotential::gpu::{Buffer, Commands, Gpu, Kernel, Rasterizer};
use gspotential::render::{Capacity, Model, Workspace};
use gspotential::train::optimizer::ResetUniform;

use super::rig::{context, context_of};
use crate::hard::specimens::{config, noise_supervision};
use crate::hard::survive;

#[test]
fn folded_grids_hold_all_workgroups_within_the_limit() {
    for limit in [1_u32, 7, 65_535] {
        let big = u64::from(limit) * u64::from(limit);
        for n in [1, 2, 6, 7, 8, 100, 65_535, 65_536, 65_537, 4_000_000] {
            if n > big {
                continue;
            }
            let (x, y) = fold(n, limit);
            assert!(x <= limit && y <= limit, "{n} workgroups, limit {limit}");
            let threads = u64::from(x) * u64::from(y);
            assert!((n..n + u64::from(y)).contains(&threads), "{n}: {x} x {y}");
        }
    }
}

#[test]
fn a_dispatch_beyond_65535_workgroups_reaches_every_element() {
    let ctx = context();
    let gpu = &ctx.gpu;
    let n = 65_535 * 64 + 1234_usize;
    let source = compose("reset_opacity", 0);
    let kernel = Kernel::from_source("reset_opacity", "reset_opacity", source);
    let reset = ResetUniform {
        ceiling: -3.0,
        frozen_beyond: f32::INFINITY,
        n_gaussians: n as u32 - 1,
        pad: 0,
    };
    let reset = Buffer::uniform_from(gpu, "reset", &reset);
    let geometry = Buffer::storage_from(gpu, "geometry", &vec![[1.0_f32; 4]; n]).expect("fits");
    let moment = Buffer::storage::<[f32; 4]>(gpu, "moment", n).expect("fits");
    let second = Buffer::storage::<[f32; 4]>(gpu, "second", n).expect("fits");
    let group = kernel.bind(
        gpu,
        &[
            ("reset", &reset),
            ("geometry", &geometry),
            ("first_moment", &moment),
            ("second_moment", &second),
        ],
    );
    let mut commands = Commands::new(gpu);
    commands.dispatch(&kernel, &group, n as u64);
    commands.submit();
    let after: Vec<[f32; 4]> = geometry.read(gpu, n).expect("readable");
    let (last, rest) = after.split_last().expect("not empty");
    let missed = rest.iter().filter(|v| **v != [1.0, 1.0, 1.0, -3.0]).count();
    assert_eq!(missed, 0);
    assert_eq!(*last, [1.0; 4], "beyond the count");
}

#[test]
fn training_with_folded_grids_is_equal_to_the_bit() {
    let start = gaussians_of(&random_scene(600, 1, 50).gaussians, 1);
    let supervision = noise_supervision(&cameras()[0]);
    let mut config = config(30);
    config.densify.start = 5;
    config.densify.end = 25;
    config.densify.interval = 10;
    config.densify.gradient_threshold = 1e-9;
    config.densify.opacity_reset_interval = 15;
    for rasterizer in Rasterizer::ALL {
        let ctx = context_of(rasterizer);
        let whole = survive(&ctx, "one row", &start, &supervision, &config).expect("trains");
        let mut gpu = Gpu::open().expect("an adapter");
        // A grid has a hundred workgroups and more: they take many rows, the last one half idle.
        gpu.limits.max_compute_workgroups_per_dimension = 7;
        let narrow = Context::from_sources(gpu, rasterizer, &compose);
        let folded = survive(&narrow, "folded", &start, &supervision, &config).expect("trains");
        assert!(!whole.plans.is_empty(), "no plan was carried out");
        assert_eq!(folded.samples, whole.samples);
        assert!(folded.gaussians == whole.gaussians, "Gaussians differ");
    }
}

#[test]
fn what_exceeds_one_binding_is_refused_with_the_numbers() {
    let ctx = context();
    let gpu = &ctx.gpu;
    let most = gpu.max_binding() as usize;
    let n = most / 48 + 1;
    let refused = Model::zeros(gpu, n, n, 0)
        .err()
        .expect("too many Gaussians");
    let text = refused.to_string();
    for part in [
        "geometry",
        &(3 * n).to_string(),
        &most.to_string(),
        "--max-points",
    ] {
        assert!(text.contains(part), "{text}");
    }
    let view = view_of(&cameras()[0]);
    let capacity = Capacity::new(ctx.kernels.rasterizer, 10, most / 8 + 1, &[view]);
    let refused = Workspace::new(gpu, capacity, false)
        .err()
        .expect("too many pairs");
    let text = refused.to_string();
    assert!(text.contains(&most.to_string()), "{text}");
    // Nothing of it has become a fault of the device.
    gpu.wait().expect("no fault");
    Model::zeros(gpu, 10, 10, 0).expect("the adapter still works");
}
