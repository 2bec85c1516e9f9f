//! The presets of other systems train.

use gspotential::config::Config;
use gspotential::pipeline::prepare;
use gspotential::run::Seconds;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::train::Trainer;

use crate::gpu::rig::context;

#[test]
fn presets_of_other_systems_train_on_the_built_in_scene() {
    let scene = scene(&BuiltinOptions {
        width: 48,
        n_test: 1,
        pixel_step: 2,
        ..BuiltinOptions::default()
    });
    let ctx = context();
    for name in ["instantsplat", "dropgaussian", "d2gs", "corgs"] {
        let mut config = Config::preset(name).expect("a preset");
        config.iterations = 40;
        config.scene.max_points = Some(500);
        config.partner.start = 20;
        let prepared = prepare(&scene, &config, &mut Seconds::default()).expect("prepares");
        let (start, supervision) = (&prepared.start, &prepared.supervision);
        assert!(supervision.virtual_views.is_empty());
        let trained = Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config)
            .and_then(|mut trainer| trainer.run(&mut ()))
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let l1 = |k: usize| trained.samples[k].real.l1;
        assert!(l1(3) < l1(0), "{name}: {} {}", l1(0), l1(3));
        assert_eq!(trained.gaussians.n_broken(), 0);
        let n_virtual = trained.samples.iter().filter(|s| s.virt.is_some()).count();
        let n_expected = if name == "corgs" { 2 } else { 0 };
        assert_eq!(n_virtual, n_expected, "{name}");
        let moved = trained.cameras.iter().zip(&supervision.real);
        let moved = moved.filter(|(after, view)| **after != view.camera).count();
        let n_moved = if name == "instantsplat" { 4 } else { 0 };
        assert_eq!(moved, n_moved, "{name}");
    }
}
