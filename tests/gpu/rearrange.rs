//! Carrying out a plan, and the opacity reset.

use glam::Vec3;
use gspotential::gaussians::Gaussians;
use gspotential::gpu::{Buffer, Gpu};
use gspotential::render::{BLOCK_PLANES, Model, n_blocks};
use gspotential::run::PlanCounts;
use gspotential::train::optimizer::Optimizer;
use gspotential::train::policy::{NEW, Plan};

use super::rig::{Context, context, gaussians_of};
use crate::twins::cases::{Random, random_scene};

fn fill(gpu: &Gpu, model: &Model, seed: u64) {
    let mut random = Random::new(seed);
    for (block, planes) in BLOCK_PLANES
        .iter()
        .enumerate()
        .take(n_blocks(model.sh_degree))
    {
        let values: Vec<f32> = (0..4 * planes * model.stride)
            .map(|_| random.normal() as f32)
            .collect();
        let buffer: &Buffer = &model.blocks[block];
        buffer.write(gpu, &values);
    }
}

/// The set that a plan makes of `old`; moments of new Gaussians are 0.
fn carried_out(old: &Gaussians, plan: &Plan, moments: bool) -> Gaussians {
    let n_sh = 3 * old.n_sh();
    let mut new = Gaussians {
        sh_degree: old.sh_degree,
        ..Gaussians::default()
    };
    for (source, change) in plan.sources.iter().zip(&plan.changes) {
        let i = (source & !NEW) as usize;
        let zero = moments && source & NEW != 0;
        let factor = if zero { 0.0 } else { 1.0 };
        let (shift, grow) = if moments {
            (Vec3::ZERO, Vec3::ZERO)
        } else {
            (
                Vec3::new(change[0], change[1], change[2]),
                Vec3::splat(change[3]),
            )
        };
        new.means.push(old.means[i] * factor + shift);
        new.scales_log.push(old.scales_log[i] * factor + grow);
        new.opacity_logits.push(old.opacity_logits[i] * factor);
        new.rotations_wxyz
            .push(old.rotations_wxyz[i].map(|q| q * factor));
        new.sh
            .extend(old.sh[i * n_sh..][..n_sh].iter().map(|s| s * factor));
    }
    new
}

fn hold(ctx: &Context, degree: u32, plan: &Plan, n: usize, stride: usize) {
    let gpu = &ctx.gpu;
    let start = gaussians_of(&random_scene(n, degree as usize, 95).gaussians, degree);
    let model = Model::upload(gpu, &start, stride).expect("fits");
    let mut optimizer = Optimizer::new(gpu, model).expect("fits");
    fill(gpu, &optimizer.first_moment, 1);
    fill(gpu, &optimizer.second_moment, 2);
    let download = |m: &Model| m.download(gpu).expect("readable");
    let old = [
        start.clone(),
        download(&optimizer.first_moment),
        download(&optimizer.second_moment),
    ];
    optimizer
        .rearrange(gpu, &ctx.optimizer, plan)
        .expect("the new set fits");
    let new = [
        download(&optimizer.model),
        download(&optimizer.first_moment),
        download(&optimizer.second_moment),
    ];
    for (which, (old, new)) in old.iter().zip(&new).enumerate() {
        let expected = carried_out(old, plan, which > 0);
        // Bit for bit: the changes are one addition each.
        assert_eq!(*new, expected, "degree {degree}, set {which}");
    }
    let statistics = optimizer.gather(gpu).expect("readable").statistics;
    assert_eq!(statistics, vec![[0.0; 3]; plan.sources.len()]);
}

#[test]
fn plans_are_carried_out_to_the_bit_at_every_degree() {
    let mut random = Random::new(96);
    let n = 150;
    let mut plan = |len: usize| {
        let mut plan = Plan {
            counts: PlanCounts::default(),
            ..Plan::default()
        };
        for _ in 0..len {
            let new = random.uniform(0.0, 1.0) < 0.4;
            let source = random.uniform(0.0, n as f64) as u32;
            plan.sources.push(if new { source | NEW } else { source });
            let change = [(); 4].map(|()| random.normal() as f32);
            plan.changes.push(if new { change } else { [0.0; 4] });
        }
        plan
    };
    let ctx = context();
    for degree in 0..4 {
        // Fewer, within the room that there is, and more.
        for len in [40, 170, 333] {
            hold(&ctx, degree, &plan(len), n, n + 30);
        }
    }
}

#[test]
fn a_plan_that_keeps_nothing_leaves_an_empty_set() {
    let ctx = context();
    hold(&ctx, 1, &Plan::default(), 20, 20);
}

#[test]
fn opacities_fall_to_the_ceiling_and_their_moments_to_zero_unless_frozen() {
    let ctx = context();
    let gpu = &ctx.gpu;
    let start = gaussians_of(&random_scene(70, 1, 97).gaussians, 1);
    let mut optimizer =
        Optimizer::new(gpu, Model::upload(gpu, &start, 75).expect("fits")).expect("fits");
    optimizer.frozen_beyond = 0.7;
    let is_frozen = |i: usize| start.means[i].length() > 0.7;
    assert!((10..60).contains(&(0..70).filter(|i| is_frozen(*i)).count()));
    fill(gpu, &optimizer.first_moment, 3);
    fill(gpu, &optimizer.second_moment, 4);
    let download = |m: &Model| m.download(gpu).expect("readable");
    let moments = [&optimizer.first_moment, &optimizer.second_moment].map(download);
    optimizer.reset_opacity(gpu, &ctx.optimizer, 0.3);
    let ceiling = (0.3_f64 / 0.7).ln() as f32;
    let mut expected = start.clone();
    for i in (0..70).filter(|i| !is_frozen(*i)) {
        expected.opacity_logits[i] = expected.opacity_logits[i].min(ceiling);
    }
    assert_ne!(expected, start);
    assert_eq!(download(&optimizer.model), expected);
    let after = [&optimizer.first_moment, &optimizer.second_moment].map(download);
    for (mut before, after) in moments.into_iter().zip(after) {
        for i in (0..70).filter(|i| !is_frozen(*i)) {
            before.opacity_logits[i] = 0.0;
        }
        assert_eq!(after, before);
    }
}
