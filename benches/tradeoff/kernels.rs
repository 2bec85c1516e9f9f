//! Views rendered and differentiated under every setting of the kernels.

use gspotential::camera::Camera;
use gspotential::config::Config;
use gspotential::doctor::twin::cases::loss_weights;
use gspotential::doctor::twin::compare::relative_l2;
use gspotential::doctor::twin::model::{TwinCamera, TwinGaussians};
use gspotential::doctor::twin::raster::{backward, render};
use gspotential::doctor::{Context, Rig, twin_of, wide};
use gspotential::error::Result;
use gspotential::gaussians::Gaussians;
use gspotential::gpu::constants::{DEPTH_BITS, RADIX_BITS};
use gspotential::gpu::shader::compose;
use gspotential::gpu::{Commands, Gpu, Profile};
use gspotential::pipeline::prepare;
use gspotential::render::{Kernels, Pass, ViewUniform};
use gspotential::run::Seconds;
use gspotential::scene::Scene;
use gspotential::train::train;

use super::Measured;
use super::clock::of_gpu;
use super::variants::{self, Variant};

/// Test views that are measured, evenly over all.
const N_VIEWS: usize = 3;

/// Times that the views are taken in a row: the system's clock of CPU time is coarse.
const REPEATS: usize = 4;

/// A view with what the reference says of it.
struct Truth {
    camera: Camera,
    rgb: Vec<f64>,
    /// Pixels where single precision may decide otherwise.
    fragile: Vec<bool>,
    d_rgb: Vec<f64>,
    d_alpha: Vec<f64>,
    gradient: Vec<f64>,
}

/// A setting, ready to run on every view.
struct Bench {
    variant: Variant,
    ctx: Context,
    rigs: Vec<Rig>,
    profile: Option<Profile>,
    best: f64,
}

/// Trains, and measures every setting; returns the adapter, too.
pub fn measure(scene: &Scene, config: &Config, rounds: usize) -> Result<(Vec<Measured>, String)> {
    let gpu = Gpu::open()?;
    let adapter = gpu.describe();
    let prepared = prepare(scene, config, &mut Seconds::default())?;
    let kernels = Kernels::new(&gpu);
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let trained = train(&gpu, &kernels, start, supervision, config, &mut ())?;
    let step = scene.test.len().div_ceil(N_VIEWS).max(1);
    let views = scene.test.iter().step_by(step);
    let cameras = views.map(|view| prepared.frame.camera_to_canonical(&view.camera));
    let twin = twin_gaussians(&trained.gaussians);
    let truths: Vec<Truth> = cameras.map(|camera| truth(&twin, camera, config)).collect();

    let mut benches = Vec::new();
    for variant in variants::all() {
        benches.push(Bench::new(variant, &trained.gaussians, &truths, config)?);
    }
    for round in 0..=rounds {
        for bench in &mut benches {
            let seconds = bench.time()?;
            // The first round compiles.
            if round > 0 {
                bench.best = bench.best.min(seconds);
            }
        }
    }
    let finest = benches.iter().position(|b| b.variant.setting == "1/65536");
    let mut images = Vec::new();
    for bench in &mut benches {
        images.push(bench.images(&truths)?);
    }
    let reference: Vec<Image> = truths
        .iter()
        .map(|t| (t.rgb.clone(), t.gradient.clone()))
        .collect();
    let measured = |choice, setting: &str, i: usize, kept| {
        // The reference has the cut-off built in; without it there is only the finest one.
        let exact = match finest {
            Some(finest) if choice == variants::ALPHA => &images[finest],
            _ => &reference,
        };
        let (error, gradient_error) = errors(&images[i], exact, &truths);
        Measured {
            choice,
            setting: setting.to_owned(),
            kept,
            seconds: benches[i].best / truths.len() as f64,
            error,
            note: format!("gradient {gradient_error:.1e}"),
        }
    };
    let mut all = Vec::new();
    for (choice, kept) in variants::KEPT {
        all.push(measured(choice, kept, 0, true));
        for (i, bench) in benches.iter().enumerate() {
            if bench.variant.choice == choice {
                all.push(measured(choice, &bench.variant.setting, i, false));
            }
        }
    }
    Ok((all, adapter))
}

/// Colours of a view, and the gradient of its parameters.
type Image = (Vec<f64>, Vec<f64>);

/// Root mean square error of the images off fragile pixels, and relative L2 of the gradients.
fn errors(ours: &[Image], exact: &[Image], truths: &[Truth]) -> (f64, f64) {
    let (mut sum, mut n) = (0.0, 0);
    let mut gradients = [Vec::new(), Vec::new()];
    for ((ours, exact), truth) in ours.iter().zip(exact).zip(truths) {
        for (i, (a, b)) in ours.0.iter().zip(&exact.0).enumerate() {
            if !truth.fragile[i / 3] {
                sum += (a - b) * (a - b);
                n += 1;
            }
        }
        gradients[0].extend_from_slice(&ours.1);
        gradients[1].extend_from_slice(&exact.1);
    }
    (
        (sum / f64::from(n.max(1))).sqrt(),
        relative_l2(&gradients[0], &gradients[1]),
    )
}

impl Bench {
    fn new(
        variant: Variant,
        gaussians: &Gaussians,
        truths: &[Truth],
        config: &Config,
    ) -> Result<Bench> {
        let sources = |stage: &str, degree| variant.apply(stage, compose(stage, degree));
        let ctx = Context::from_sources(Gpu::open()?, &sources)?;
        let mut rigs = Vec::new();
        for truth in truths {
            let model = &config.model;
            let view = ViewUniform::new(&truth.camera, model.near, model.background);
            let mut rig = Rig::new(&ctx, gaussians, view, gaussians.sh_degree)?;
            if variant.half_sh {
                halve(&ctx, &rig)?;
            }
            rig.forward(&ctx)?;
            rig.write_image(&ctx, "d_rendered", &truth.d_rgb, &truth.d_alpha, 0.0);
            rigs.push(rig);
        }
        Ok(Bench {
            profile: Profile::new(&ctx.gpu),
            variant,
            ctx,
            rigs,
            best: f64::INFINITY,
        })
    }

    /// Seconds of all views, forward and backward.
    fn time(&mut self) -> Result<f64> {
        let all = self.time_of(|pass, commands| {
            commands.clear(&pass.workspace.totals);
            pass.forward(commands);
            pass.backward(commands);
        })?;
        // The program's sort has passes for all bits of its keys; of fewer, as many would do.
        let passes = |bits: u32| f64::from(bits.div_ceil(RADIX_BITS));
        let spared = 1.0 - passes(self.variant.depth_bits) / passes(DEPTH_BITS);
        if spared == 0.0 {
            return Ok(all);
        }
        let sort = self.time_of(|pass, commands| pass.sort_by_depth(commands))?;
        Ok(all - spared * sort)
    }

    /// Seconds of `record` over all views.
    fn time_of(&mut self, record: fn(&Pass<'_>, &mut Commands<'_>)) -> Result<f64> {
        let (ctx, rigs) = (&self.ctx, &self.rigs);
        let seconds = of_gpu(&ctx.gpu, &mut self.profile, |commands| {
            for rig in (0..REPEATS).flat_map(|_| rigs) {
                record(&rig.pass(ctx), commands);
            }
        })?;
        Ok(seconds / REPEATS as f64)
    }

    fn images(&mut self, truths: &[Truth]) -> Result<Vec<Image>> {
        let mut images = Vec::new();
        for (rig, truth) in self.rigs.iter_mut().zip(truths) {
            let rgb = wide(&rig.forward(&self.ctx)?.rgb);
            let g = rig.backward(&self.ctx, &truth.d_rgb, &truth.d_alpha)?;
            images.push((
                rgb,
                [g.means, g.opacity_logit, g.scale_log, g.rotation_wxyz].concat(),
            ));
        }
        Ok(images)
    }
}

/// Packs the SH planes of a rig as half floats.
fn halve(ctx: &Context, rig: &Rig) -> Result<()> {
    for block in &rig.model.blocks[1..] {
        let n = block.bytes() as usize / 4;
        let values: Vec<f32> = block.read(&ctx.gpu, n)?;
        let halves: Vec<u16> = values.iter().map(|x| half_bits(*x)).collect();
        block.write(&ctx.gpu, &halves);
    }
    Ok(())
}

/// Half-float bits of a number, to nearest, ties to even; beyond its range the largest.
fn half_bits(x: f32) -> u16 {
    let sign = ((x.to_bits() >> 16) & 0x8000) as u16;
    let magnitude = x.abs().min(65_504.0);
    // Below 2^-14 halves are spaced 2^-24 apart.
    let exponent = (magnitude.to_bits() >> 23).max(113);
    let spacing = f32::from_bits((exponent - 10) << 23);
    // Adding and taking away 2^23 spacings rounds to a whole number of them.
    let steps = (magnitude / spacing).round_ties_even() as u32;
    let bits = ((exponent - 113) << 10) + steps;
    sign | bits as u16
}

/// The reference's image, and the gradient of a random linear loss of it.
fn truth(gaussians: &TwinGaussians, camera: Camera, config: &Config) -> Truth {
    let twin = TwinCamera {
        background: config.model.background,
        ..twin_of(&camera, config.model.near)
    };
    let image = render(gaussians, &twin);
    let (d_rgb, d_alpha) = loss_weights(&image, 1);
    let [means, _, opacity, scales, rotations] =
        backward(gaussians, &twin, &image, &d_rgb, &d_alpha).classes();
    Truth {
        camera,
        rgb: image.rgb,
        fragile: image.fragile,
        d_rgb,
        d_alpha,
        gradient: [means.1, opacity.1, scales.1, rotations.1].concat(),
    }
}

fn twin_gaussians(g: &Gaussians) -> TwinGaussians {
    let n_sh = 3 * g.n_sh();
    let xyz = |v: &glam::Vec3| v.to_array().map(f64::from);
    let sh = g.sh.chunks_exact(n_sh).map(|own| {
        let mut sh = [[0.0; 3]; 16];
        let coefficients = own.as_chunks::<3>().0;
        for (k, coefficient) in coefficients.iter().enumerate() {
            sh[k] = coefficient.map(f64::from);
        }
        sh
    });
    TwinGaussians {
        means: g.means.iter().map(xyz).collect(),
        sh: sh.collect(),
        opacity_logit: wide(&g.opacity_logits),
        scale_log: g.scales_log.iter().map(xyz).collect(),
        rotation_wxyz: g.rotations_wxyz.iter().map(|q| q.map(f64::from)).collect(),
        sh_degree: g.sh_degree as usize,
    }
}
