//! Adam on the GPU against the reference, steps that do not count, and the statistics.

use gspotential::doctor::adam::{
    CENTERS, FLAT_WEIGHT, FROZEN_BEYOND, Treatment, config, examine, workspace,
};
use gspotential::doctor::gaussians_of;
use gspotential::doctor::twin::cases::random_scene;
use gspotential::gpu::Commands;
use gspotential::render::Model;
use gspotential::train::optimizer::{Optimizer, StepUniform};

use super::rig::{assert_findings, context};
use super::views::print;

const N: usize = 130;

#[test]
fn adam_matches_the_reference_at_every_degree_for_one_view_and_two() {
    for stored in 0..4 {
        for n_views in [1, 2] {
            let found = examine(&context(), stored, n_views, Treatment::ALIKE).expect("steps");
            let share = assert_findings(&found);
            print(&format!(
                "Adam, degree {stored}, {n_views} views: {:.1} % of the bound\n",
                100.0 * share
            ));
        }
    }
}

#[test]
fn frozen_geometry_stays_as_in_the_reference() {
    let frozen = Treatment {
        frozen_beyond: FROZEN_BEYOND,
        ..Treatment::ALIKE
    };
    assert_findings(&examine(&context(), 1, 2, frozen).expect("steps"));
    // It matters for some and not for others.
    let start = gaussians_of(&random_scene(N, 1, 81).gaussians, 1);
    let is_frozen = |i: &usize| start.means[*i].length() > FROZEN_BEYOND;
    let n_frozen = (0..N).filter(is_frozen).count();
    assert!((N / 4..3 * N / 4).contains(&n_frozen), "{n_frozen} of {N}");
}

#[test]
fn positions_with_rates_of_their_own_match_the_reference_and_nothing_else_does_otherwise() {
    for frozen_beyond in [f32::INFINITY, FROZEN_BEYOND] {
        let treatment = Treatment {
            frozen_beyond,
            own_rates: true,
            ..Treatment::ALIKE
        };
        assert_findings(&examine(&context(), 2, 2, treatment).expect("steps"));
    }
}

#[test]
fn drawn_gaussians_become_flat_as_in_the_reference() {
    let flattened = Treatment {
        flat_weight: FLAT_WEIGHT,
        ..Treatment::ALIKE
    };
    assert_findings(&examine(&context(), 0, 1, flattened).expect("steps"));
}

#[test]
fn gains_of_nothing_change_no_bit() {
    let ctx = context();
    let gpu = &ctx.gpu;
    let start = gaussians_of(&random_scene(N, 1, 94).gaussians, 1);
    let stepped = |gains: &[f32]| {
        let model = Model::upload(gpu, &start, N).expect("fits");
        let mut optimizer = Optimizer::new(gpu, model).expect("fits");
        optimizer.set_position_gains(gpu, gains);
        let space = workspace(&ctx, N).expect("fits");
        let groups = optimizer.bind(gpu, &ctx.optimizer, &space);
        let gradient: Vec<f32> = (0..12 * N).map(|i| (i as f32).sin()).collect();
        space.buffer("d_geometry").write(gpu, &gradient);
        space.buffer("d_color").write(gpu, &vec![0.5_f32; 8 * N]);
        space.buffer("screen").write(gpu, &vec![[1.0_f32; 2]; N]);
        space.buffer("totals").write(gpu, &[0_u32; 4]);
        let step = StepUniform::new(&config().expect("a config"), 0, 1.0, &CENTERS);
        let mut commands = Commands::new(gpu);
        optimizer.step(gpu, &ctx.optimizer, &groups, &mut commands, step, 1);
        commands.submit();
        optimizer.model.download(gpu).expect("readable")
    };
    let plain = stepped(&[]);
    assert!(stepped(&[0.0; N]) == plain);
    assert!(stepped(&[1.0; N]) != plain);
}

#[test]
fn a_step_whose_pairs_did_not_fit_changes_nothing() {
    let ctx = context();
    let gpu = &ctx.gpu;
    let case = random_scene(N, 3, 90);
    let start = gaussians_of(&case.gaussians, 3);
    let model = Model::upload(gpu, &start, N).expect("fits");
    let optimizer = Optimizer::new(gpu, model).expect("fits");
    let space = workspace(&ctx, N).expect("fits");
    let groups = optimizer.bind(gpu, &ctx.optimizer, &space);
    space
        .buffer("d_geometry")
        .write(gpu, &vec![1.0_f32; 12 * N]);
    space.buffer("d_color").write(gpu, &vec![1.0_f32; 8 * N]);
    space.buffer("screen").write(gpu, &vec![[1.0_f32; 2]; N]);
    for (overflow, changes) in [(1_u32, false), (0, true)] {
        space.buffer("totals").write(gpu, &[9_u32, 9, overflow, 9]);
        let step = StepUniform::new(&config().expect("a config"), 0, 1.0, &CENTERS);
        let mut commands = Commands::new(gpu);
        optimizer.step(gpu, &ctx.optimizer, &groups, &mut commands, step, 3);
        commands.submit();
        let after = optimizer.model.download(gpu).expect("readable");
        assert_eq!(after != start, changes);
        let statistics = optimizer.gather(gpu).expect("readable").statistics;
        let expected = if changes { [1.0; 3] } else { [0.0; 3] };
        assert!(statistics.iter().all(|s| *s == expected));
    }
}

#[test]
fn statistics_sum_gradients_and_views_and_keep_the_largest_radius() {
    let ctx = context();
    let gpu = &ctx.gpu;
    let start = gaussians_of(&random_scene(3, 0, 92).gaussians, 0);
    let optimizer =
        Optimizer::new(gpu, Model::upload(gpu, &start, 3).expect("fits")).expect("fits");
    let space = workspace(&ctx, 3).expect("fits");
    let groups = optimizer.bind(gpu, &ctx.optimizer, &space);
    space.buffer("totals").write(gpu, &[0_u32; 4]);
    space.buffer("d_geometry").write(gpu, &[0.0_f32; 36]);
    space.buffer("d_color").write(gpu, &[0.0_f32; 24]);
    // A radius of 0: not drawn.
    for screen in [
        [[1.0, 0.5], [0.25, 0.125], [3.0, 0.0]],
        [[2.0, 0.25], [0.0, 0.0], [5.0, 0.0]],
    ] {
        let screen: [[f32; 2]; 3] = screen;
        space.buffer("screen").write(gpu, &screen);
        let step = StepUniform::new(&config().expect("a config"), 0, 1.0, &CENTERS);
        let mut commands = Commands::new(gpu);
        optimizer.step(gpu, &ctx.optimizer, &groups, &mut commands, step, 0);
        commands.submit();
    }
    let statistics = optimizer.gather(gpu).expect("readable").statistics;
    assert_eq!(statistics, [[3.0, 2.0, 0.5], [0.25, 1.0, 0.125], [0.0; 3]]);
    // Without gradients nothing has moved.
    assert_eq!(optimizer.model.download(gpu).expect("readable"), start);
}
