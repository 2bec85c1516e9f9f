//! Single Gaussians of every unreasonable kind, among ordinary ones.

use glam::{DVec3, Vec3};
use gspotential::config::{Config, Kernel};
use gspotential::doctor::twin::cases::{looking_at, loss_weights, random_scene};
use gspotential::doctor::twin::compare::{max_abs_off_mask, relative_l2};
use gspotential::doctor::twin::model::{TwinCamera, TwinGaussians};
use gspotential::doctor::twin::random::Random;
use gspotential::doctor::twin::raster::{backward, render};
use gspotential::doctor::{Context, Rig, camera_of, gaussians_of, view_of, wide};
use gspotential::field::{Coverage, Field, fibonacci_sphere};
use gspotential::gaussians::Gaussians;
use gspotential::train::{Supervision, TrainingView};

use super::survive;
use crate::gpu::rig::context;
use crate::gpu::views::print;

/// What becomes of it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fate {
    /// Drawn as in the f64 reference.
    Drawn,
    /// Does not exist for the render: behind, too faint, or beyond saving.
    Dropped,
}
use Fate::{Drawn, Dropped};

struct Specimen {
    name: &'static str,
    mean: [f64; 3],
    scale: [f64; 3],
    opacity_logit: f64,
    rotation: [f64; 4],
    sh: f64,
    fate: Fate,
}

fn camera() -> TwinCamera {
    looking_at([0.0, 0.0, -1.5], [0.0; 3]).resized(97, 63)
}

fn specimens() -> Vec<Specimen> {
    let usual = || Specimen {
        name: "usual",
        mean: [0.05, -0.03, 0.1],
        scale: [0.1, 0.05, 0.07],
        opacity_logit: 0.5,
        rotation: [0.9, 0.3, -0.2, 0.4],
        sh: 0.3,
        fate: Drawn,
    };
    let scaled = |name, scale| Specimen {
        name,
        scale,
        ..usual()
    };
    let placed = |name, mean, fate| Specimen {
        name,
        mean,
        fate,
        ..usual()
    };
    let lost = |name, change: fn(&mut Specimen)| {
        let mut s = usual();
        (s.name, s.fate) = (name, Dropped);
        change(&mut s);
        s
    };
    let near = camera().near;
    vec![
        usual(),
        scaled("needle 1:1e6", [0.5, 5e-7, 5e-7]),
        scaled("needle 1:1e6, longer than the view", [20.0, 2e-5, 2e-5]),
        scaled("pancake 1e6:1", [0.3, 0.3, 3e-7]),
        Specimen {
            rotation: [1.0, 0.0, 1.0, 0.0],
            ..scaled("pancake on edge", [0.3, 0.3, 3e-7])
        },
        scaled("scale 1e-8", [1e-8; 3]),
        scaled("scale 1e8", [1e8; 3]),
        scaled("scale 0", [0.0; 3]),
        scaled("covers the screen", [30.0, 11.0, 5.0]),
        Specimen {
            scale: [1.5, 1.0, 0.7],
            ..placed("centred beside the screen", [2.5, 0.1, 0.2], Drawn)
        },
        Specimen {
            scale: [0.3; 3],
            ..placed(
                "across the near plane",
                [0.01, 0.01, -1.5 + near + 1e-3],
                Drawn,
            )
        },
        Specimen {
            scale: [0.3; 3],
            ..placed(
                "across the near plane, aside",
                [0.4, 0.2, -1.5 + near + 1e-3],
                Drawn,
            )
        },
        placed(
            "before the near plane",
            [0.0, 0.0, -1.5 + 0.5 * near],
            Dropped,
        ),
        Specimen {
            scale: [5.0; 3],
            ..placed("behind the camera", [0.0, 0.0, -2.5], Dropped)
        },
        placed("at the camera's centre", [0.0, 0.0, -1.5], Dropped),
        placed("a thousand scene sizes away", [3.0, 1.0, 1000.0], Drawn),
        Specimen {
            name: "logit 40",
            opacity_logit: 40.0,
            ..usual()
        },
        lost("logit -40", |s| s.opacity_logit = -40.0),
        lost("logit -1e30", |s| s.opacity_logit = -1e30),
        Specimen {
            name: "logit 1e30",
            opacity_logit: 1e30,
            ..usual()
        },
        Specimen {
            name: "quaternion of length 1e-12",
            rotation: [0.9e-12, 0.3e-12, -0.2e-12, 0.4e-12],
            ..usual()
        },
        Specimen {
            name: "quaternion of length 1e12",
            rotation: [0.9e12, 0.3e12, -0.2e12, 0.4e12],
            ..usual()
        },
        Specimen {
            name: "colours of 1e4",
            sh: 1e4,
            ..usual()
        },
        lost("quaternion 0", |s| s.rotation = [0.0; 4]),
        lost("infinite scale", |s| s.scale[1] = f64::INFINITY),
        lost("scale 1e30", |s| s.scale[1] = 1e30),
        lost("NaN mean", |s| s.mean[0] = f64::NAN),
        lost("NaN depth", |s| s.mean[2] = f64::NAN),
        lost("infinite mean", |s| s.mean[1] = f64::INFINITY),
        lost("infinite depth", |s| s.mean[2] = f64::INFINITY),
        lost("NaN scale", |s| s.scale[2] = f64::NAN),
        lost("NaN logit", |s| s.opacity_logit = f64::NAN),
        lost("NaN quaternion", |s| s.rotation[3] = f64::NAN),
        lost("infinite quaternion", |s| s.rotation[0] = f64::INFINITY),
        lost("NaN colour", |s| s.sh = f64::NAN),
        lost("infinite colour", |s| s.sh = f64::INFINITY),
    ]
}

fn backdrop() -> TwinGaussians {
    random_scene(120, 1, 33).gaussians
}

fn add(gaussians: &mut TwinGaussians, s: &Specimen) {
    gaussians.means.push(s.mean.map(|x| f64::from(x as f32)));
    let mut sh = [[0.0; 3]; 16];
    sh[0] = [s.sh, 0.1, -0.2].map(|x| f64::from(x as f32));
    sh[1] = [0.1, f64::from(0.2_f32), 0.0].map(|x| f64::from(x as f32));
    gaussians.sh.push(sh);
    gaussians
        .opacity_logit
        .push(f64::from(s.opacity_logit as f32));
    gaussians
        .scale_log
        .push(s.scale.map(|x| f64::from(x.ln() as f32)));
    gaussians
        .rotation_wxyz
        .push(s.rotation.map(|x| f64::from(x as f32)));
}

/// One real view of noise.
pub(crate) fn noise_supervision(camera: &TwinCamera) -> Supervision {
    let mut random = Random::new(11);
    let n = camera.width * camera.height;
    let goal: Vec<u32> = (0..n)
        .map(|_| random.uniform(0.0, f64::from(1 << 24)) as u32 | 0xff00_0000)
        .collect();
    let field = Field {
        directions: vec![DVec3::NEG_Z],
        kernel: Kernel::Sech,
        sigma: 5.3,
        lambda: 0.2,
    };
    Supervision {
        real: vec![TrainingView::photograph(camera_of(camera), &goal)],
        virtual_views: Vec::new(),
        held_out: Vec::new(),
        coverage: Coverage::new(&field, &fibonacci_sphere(64)),
        extent: 1.0,
        near: camera.near,
        shell: None,
        position_gains: Vec::new(),
    }
}

pub(crate) fn config(iterations: u32) -> Config {
    let mut config = Config::preset("paper").expect("a preset");
    config.iterations = iterations;
    config.model.near = camera().near;
    config.model.sh_degree = 1;
    config.model.sh_interval = 4;
    config.views.count = 0;
    config
}

struct Row {
    image: f64,
    gradient: f64,
}

fn examine(ctx: &Context, s: &Specimen) -> Row {
    let camera = camera();
    let mut twin = backdrop();
    let bare = gaussians_of(&twin, 1);
    let mut plain = Rig::new(ctx, &bare, view_of(&camera), 1).expect("fits");
    let plain = plain.forward(ctx).expect("renders");
    if s.fate == Drawn {
        add(&mut twin, s);
    }
    let truth = render(&twin, &camera);
    if s.fate == Dropped {
        add(&mut twin, s);
    }
    let gaussians = gaussians_of(&twin, 1);
    let mut rig = Rig::new(ctx, &gaussians, view_of(&camera), 1).expect("fits");
    let image = rig.forward(ctx).expect("renders");
    if s.fate == Dropped {
        assert!(image == plain, "{}: is drawn", s.name);
    } else {
        assert!(image != plain, "{}: is not drawn", s.name);
    }
    // Colours of 1e4 are held to their own size.
    let range = s.sh.abs().max(1.0);
    let range = if s.fate == Drawn { range } else { 1.0 };
    let error = max_abs_off_mask(&wide(&image.rgb), &truth.rgb, &truth.fragile) / range;

    let (d_rgb, d_alpha) = loss_weights(&truth, 3);
    let ours = rig.backward(ctx, &d_rgb, &d_alpha);
    let ours = ours.expect("differentiates");
    let classes = [
        &ours.means,
        &ours.opacity_logit,
        &ours.scale_log,
        &ours.rotation_wxyz,
    ];
    for values in classes {
        assert!(values.iter().all(|v| v.is_finite()), "{}: gradient", s.name);
    }
    assert!(
        ours.color.as_flattened().iter().all(|v| v.is_finite()),
        "{}",
        s.name
    );
    let mut worst = 0.0f64;
    if s.fate == Drawn {
        let reference = backward(&twin, &camera, &truth, &d_rgb, &d_alpha);
        let [(_, means), _, (_, opacity), (_, scales), (_, rotations)] = reference.classes();
        for (ours, truth) in classes.iter().zip([means, opacity, scales, rotations]) {
            worst = worst.max(relative_l2(ours, &truth));
        }
    } else {
        let last = [ours.means.len() - 3, ours.scale_log.len() - 3];
        assert_eq!(ours.means[last[0]..], [0.0; 3], "{}", s.name);
        assert_eq!(ours.scale_log[last[1]..], [0.0; 3], "{}", s.name);
    }

    let trained = survive(
        ctx,
        s.name,
        &gaussians,
        &noise_supervision(&camera),
        &config(12),
    )
    .unwrap_or_else(|e| panic!("{}: {e}", s.name));
    let last = |g: &Gaussians| -> Vec<u32> {
        let i = g.len() - 1;
        let mean: Vec3 = g.means[i];
        let mut bits: Vec<u32> = mean.to_array().map(f32::to_bits).to_vec();
        bits.push(g.opacity_logits[i].to_bits());
        bits.extend(g.scales_log[i].to_array().map(f32::to_bits));
        bits.extend(g.rotations_wxyz[i].map(f32::to_bits));
        bits
    };
    if s.fate == Dropped {
        let kept = last(&trained.gaussians) == last(&gaussians);
        assert!(kept, "{}: what is not drawn has moved", s.name);
    }
    Row {
        image: error,
        gradient: worst,
    }
}

#[test]
fn unreasonable_gaussians_are_drawn_as_in_the_reference_or_not_at_all() {
    let mut failures = Vec::new();
    let mut table = String::from("| Gaussian | fate | image | gradient |\n|---|---|---|---|\n");
    for s in specimens() {
        let Row { image, gradient } = examine(&context(), &s);
        table += &format!(
            "| {} | {:?} | {image:.1e} | {gradient:.1e} |\n",
            s.name, s.fate
        );
        if image.is_nan() || image > 1e-5 || gradient.is_nan() || gradient > 1e-4 {
            failures.push(s.name);
        }
    }
    print(&table);
    assert!(failures.is_empty(), "{failures:?}");
}

#[test]
fn any_near_plane_that_is_not_negative_gives_the_reference_image() {
    let gaussians = random_scene(150, 1, 34).gaussians;
    let mut images = Vec::new();
    for near in [0.0, 1e-30, 1e-6, 0.1] {
        let camera = TwinCamera {
            near: f64::from(near as f32),
            ..camera()
        };
        let truth = render(&gaussians, &camera);
        let ctx = context();
        let rig = Rig::new(&ctx, &gaussians_of(&gaussians, 1), view_of(&camera), 1);
        let image = rig.expect("fits").forward(&ctx).expect("renders");
        let error = max_abs_off_mask(&wide(&image.rgb), &truth.rgb, &truth.fragile);
        assert!(error < 1e-5, "near {near}: {error:e}");
        images.push(image);
    }
    assert!(images.iter().all(|image| *image == images[0]));
}
