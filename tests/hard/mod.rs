//! Inputs on which others break. Each case renders or trains on the GPU, and asserts finite
//! values, bounded parameters and an outcome that makes sense.

mod layouts;
pub(crate) mod specimens;
mod training;

use gspotential::config::Config;
use gspotential::doctor::Context;
use gspotential::error::Result;
use gspotential::gaussians::Gaussians;
use gspotential::train::{Supervision, Trained, train};

/// Every parameter, class by class and one Gaussian after the other.
fn parameters(g: &Gaussians) -> [(&'static str, usize, Vec<f32>); 5] {
    let xyz = |v: &[glam::Vec3]| v.iter().flat_map(|v| v.to_array()).collect();
    [
        ("mean", 3, xyz(&g.means)),
        ("opacity", 1, g.opacity_logits.clone()),
        ("scale", 3, xyz(&g.scales_log)),
        ("rotation", 4, g.rotations_wxyz.as_flattened().to_vec()),
        ("sh", 3 * g.n_sh(), g.sh.clone()),
    ]
}

/// Trains, and fails where a loss is not finite or beyond its range, a parameter that was finite
/// no longer is, or one has gone further than Adam's steps can carry it.
pub(crate) fn survive(
    ctx: &Context,
    name: &str,
    start: &Gaussians,
    supervision: &Supervision,
    config: &Config,
) -> Result<Trained> {
    let trained = train(&ctx.gpu, &ctx.kernels, start, supervision, config, &mut ())?;
    assert!(!trained.samples.is_empty(), "{name}");
    for sample in &trained.samples {
        let losses = [Some(sample.real), sample.virt];
        let bounded = losses
            .iter()
            .flatten()
            .all(|l| (0.0..=2.0).contains(&l.l1) && (-1.0001..=1.0001).contains(&l.ssim));
        assert!(bounded && sample.loss.is_finite(), "{name}: {sample:?}");
    }
    if trained.plans.is_empty() {
        let o = &config.optimizer;
        let rates = [
            o.mean_lr_start * supervision.extent,
            o.opacity_lr,
            o.scale_lr,
            o.rotation_lr,
            o.sh_lr,
        ];
        // What starts with a NaN is beyond saving, and only has to keep to itself.
        let first = parameters(start);
        let sound: Vec<bool> = (0..start.len())
            .map(|i| {
                let mut own = first.iter().flat_map(|(_, per, v)| &v[i * per..][..*per]);
                own.all(|x| x.is_finite())
            })
            .collect();
        let classes = first.into_iter().zip(parameters(&trained.gaussians));
        for (((class, per, before), (_, _, after)), rate) in classes.zip(rates) {
            // |m| / sqrt(v) <= (1 - beta1) / sqrt(1 - beta2) = 3.2 in the worst case.
            let bound = 4.0 * rate * f64::from(config.iterations);
            let pairs = before.iter().zip(&after).enumerate();
            for (i, (b, a)) in pairs.filter(|(i, _)| sound[i / per]) {
                let moved = f64::from((a - b).abs());
                let held = b.to_bits() == a.to_bits() || moved <= bound + 1e-6 * f64::from(b.abs());
                assert!(held, "{name}: {class} of Gaussian {}: {b} -> {a}", i / per);
            }
        }
    } else {
        for (class, per, after) in parameters(&trained.gaussians) {
            let bad = after.iter().position(|a| !a.is_finite() || a.abs() > 1e3);
            assert!(
                bad.is_none(),
                "{name}: {class} of Gaussian {:?}",
                bad.map(|i| i / per)
            );
        }
    }
    Ok(trained)
}
