//! The image losses and their gradient against the twin.

use glam::{DMat3, DVec3, Vec3};
use gspotential::camera::Camera;
use gspotential::gaussians::Gaussians;
use gspotential::render::{LossUniform, ViewUniform};

use super::render::print;
use super::rig::{Rig, assert_held, context, wide};
use crate::twins::cases::Random;
use crate::twins::{loss, tolerance};

/// A rig for images of this size; what it would render does not matter.
fn rig(ctx: &super::rig::Context, width: usize, height: usize) -> Rig {
    let camera = Camera {
        name: "any".into(),
        width: width as u32,
        height: height as u32,
        fx: 10.0,
        fy: 10.0,
        cx: 0.5 * width as f64,
        cy: 0.5 * height as f64,
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    let gaussians = Gaussians {
        means: vec![Vec3::Z],
        scales_log: vec![Vec3::splat(-3.0)],
        rotations_wxyz: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.0],
        sh: vec![0.0; 3],
        sh_degree: 0,
    };
    Rig::new(
        ctx,
        &gaussians,
        ViewUniform::new(&camera, 0.01, [0.0; 3]),
        0,
    )
}

/// What the images look like.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Noise,
    /// Flat but for the last bits of 8: SSIM's variances nearly vanish.
    Flat,
    /// The render is exactly the goal.
    Equal,
    Black,
}

/// Errors of L1, SSIM and the gradient (relative L2), the largest so far.
type Worst = [f64; 3];

fn hold(
    name: &str,
    (width, height): (usize, usize),
    mask: Option<&[u8]>,
    kind: Kind,
    worst: &mut Worst,
) {
    let mut random = Random::new(width as u64 * 1000 + height as u64);
    let n = width * height;
    let mut bytes = Vec::new();
    let mut render = Vec::new();
    for i in 0..3 * n {
        let (byte, value) = match kind {
            Kind::Noise => (random.uniform(0.0, 256.0), random.uniform(-0.2, 1.2)),
            Kind::Flat => (
                200.0 + random.uniform(0.0, 2.0),
                0.79 + 1e-3 * random.uniform(-1.0, 1.0),
            ),
            Kind::Equal => {
                let byte = (i % 256) as f64;
                (byte, f64::from((byte / 255.0) as f32))
            }
            Kind::Black => (0.0, 0.0),
        };
        bytes.push(byte as u8);
        render.push(f64::from(value as f32));
    }
    let target: Vec<f64> = bytes.iter().map(|b| f64::from(*b) / 255.0).collect();
    let weights: Option<Vec<f64>> = mask.map(|m| m.iter().map(|a| f64::from(*a) / 255.0).collect());
    let twin = loss::loss(&render, &target, weights.as_deref(), width, height, 0.2);
    let goal: Vec<u32> = (0..n)
        .map(|p| {
            let alpha = mask.map_or(255, |m| m[p]);
            u32::from_le_bytes([bytes[3 * p], bytes[3 * p + 1], bytes[3 * p + 2], alpha])
        })
        .collect();
    let n_valid = mask.map_or(n, |m| m.iter().filter(|alpha| **alpha > 0).count());
    let total = weights.map_or(n as f64, |w| w.iter().sum());

    let ctx = context();
    let rig = rig(&ctx, width, height);
    rig.poison(&ctx);
    ctx.gpu.wait().expect("no fault");
    let channel = |c: usize| -> Vec<f64> { render.iter().skip(c).step_by(3).copied().collect() };
    let planes = [channel(0), channel(1), channel(2), vec![0.5; n]];
    // What lies in the padding must not matter.
    rig.write_planes(&ctx, "rendered", planes.each_ref().map(Vec::as_slice), 7.0);
    let uniform = LossUniform::new(1.0, 0.2, total, mask.is_some());
    let [l1, ssim] = rig.loss(&ctx, uniform, &goal);
    let [r, g, b, _] = rig.read_planes(&ctx, "d_rendered");
    let ours: Vec<f64> = (0..n)
        .flat_map(|i| [r[i], g[i], b[i]])
        .map(f64::from)
        .collect();
    let plane = 4 * rig.view.plane_len();
    let padded = wide(&rig.read::<f32>(&ctx, "d_rendered", 3 * plane));
    drop(ctx);

    let sum = |v: &[f64]| v.iter().map(|x| x.abs()).sum::<f64>();
    assert!(
        (sum(&padded) - sum(&ours)).abs() <= 1e-12 * sum(&ours),
        "{name}: the padding carries a gradient"
    );
    if n_valid == 0 {
        assert_eq!([l1, ssim], [0.0, 0.0], "{name}");
        assert!(ours.iter().all(|d| *d == 0.0), "{name}: gradient");
        return;
    }
    let bound = match kind {
        Kind::Noise if n_valid > 1 => tolerance::GPU_LOSS,
        _ => tolerance::GPU_LOSS_FLAT,
    };
    let errors = [(l1 - twin.l1).abs(), (ssim - twin.ssim).abs()];
    assert!(
        errors[0] <= tolerance::GPU_LOSS && errors[1] <= bound,
        "{name}: L1 {l1} {}, SSIM {ssim} {}",
        twin.l1,
        twin.ssim
    );
    let d = match kind {
        // The gradient is 0 or hangs on the sign of rounding: bounded is all it can be.
        Kind::Equal | Kind::Black => {
            let largest = ours.iter().fold(0.0f64, |m, d| m.max(d.abs()));
            assert!(largest <= 1.0 / total, "{name}: gradient {largest}");
            0.0
        }
        _ => assert_held(name, &ours, &twin.d_render, bound),
    };
    for (worst, error) in worst.iter_mut().zip([errors[0], errors[1], d]) {
        *worst = worst.max(error);
    }
}

fn report(name: &str, [l1, ssim, d]: Worst) {
    print(&format!(
        "{name}: L1 off by {l1:.1e}, SSIM by {ssim:.1e}, gradient by {d:.1e}\n"
    ));
}

const SIZES: [(usize, usize); 6] = [(1, 1), (7, 5), (33, 17), (64, 48), (5, 70), (131, 2)];

#[test]
fn losses_match_the_twin_at_odd_sizes() {
    for kind in [Kind::Noise, Kind::Flat, Kind::Equal, Kind::Black] {
        let mut worst = Worst::default();
        for size in SIZES {
            hold(&format!("{kind:?} {size:?}"), size, None, kind, &mut worst);
        }
        report(&format!("{kind:?}"), worst);
    }
}

#[test]
fn masked_losses_match_the_twin_at_odd_sizes() {
    let mut worst = [Worst::default(); 2];
    for size in SIZES {
        let n = size.0 * size.1;
        let mut random = Random::new(n as u64);
        let half: Vec<u8> = (0..n)
            .map(|_| 255 * random.uniform(0.0, 2.0) as u8)
            .collect();
        let mut one = vec![0; n];
        one[n / 2] = 255;
        let is_kept = |p: usize| {
            let (x, y) = (p % size.0, p / size.0);
            !(x > size.0 / 4 && y > size.1 / 4 && x < size.0 / 2)
        };
        let hole: Vec<u8> = (0..n).map(|p| 255 * u8::from(is_kept(p))).collect();
        let filled: Vec<u8> = hole.iter().map(|alpha| (*alpha).max(77)).collect();
        let any: Vec<u8> = (0..n).map(|_| random.uniform(0.0, 256.0) as u8).collect();
        for (what, mask) in [
            ("half", &half),
            ("one", &one),
            ("hole", &hole),
            ("filled", &filled),
            ("any", &any),
            ("full", &vec![255; n]),
            ("empty", &vec![0; n]),
        ] {
            for (kind, worst) in [Kind::Noise, Kind::Flat].into_iter().zip(&mut worst) {
                let name = format!("{what} {kind:?} {size:?}");
                hold(&name, size, Some(mask), kind, worst);
            }
        }
    }
    report("masked Noise", worst[0]);
    report("masked Flat", worst[1]);
}
