//! 2^x: a rule and a check at the start say whose, and the check sees what is off.

use gspotential::config::Exp2Choice::{Adapter, Auto, Polynomial};
use gspotential::doctor::twin::cases::{cameras, random_scene};
use gspotential::doctor::{Context, Rig, gaussians_of, view_of};
use gspotential::gpu::exp2::{MOST_ULPS, kernel, worst_ulps};
use gspotential::gpu::shader::compose;
use gspotential::gpu::{Exp2, Gpu, Rasterizer};
use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, Other, VirtualGpu};

use super::rig::context;

#[test]
fn the_check_sees_what_is_off_by_more_than_two_units() {
    let gpu = &context().gpu;
    let own = worst_ulps(gpu, &kernel(&compose)).expect("computes");
    assert!(own < 1.5, "{own}");
    for (slip, least) in [
        ("return bitcast<vec4f>(bitcast<vec4i>(p) + 3", MOST_ULPS),
        ("return bitcast<vec4f>(bitcast<vec4i>(p) + 100", 90.0),
        (
            "return vec4f(bitcast<f32>(0x7fc00000u + u32(n.x) * 0u)) * bitcast<vec4f>(bitcast<vec4i>(p)",
            1e30,
        ),
    ] {
        let planted = |stage: &str, degree: u32| {
            let source = compose(stage, degree);
            source.replace("return bitcast<vec4f>(bitcast<vec4i>(p)", slip)
        };
        assert_ne!(planted("exp2", 0), compose("exp2", 0));
        let error = worst_ulps(gpu, &kernel(&planted)).expect("computes");
        assert!(error > least, "{slip}: {error}");
        assert_eq!(Exp2::by_error(error), Exp2::Polynomial);
    }
    assert_eq!(Exp2::by_error(own), Exp2::Adapter);
    assert_eq!(Exp2::by_error(MOST_ULPS), Exp2::Adapter);
    assert_eq!(Exp2::by_error(f64::INFINITY), Exp2::Polynomial);
}

#[test]
fn the_choice_follows_the_adapters_kind_and_the_check() {
    let mut gpu = Gpu::open().expect("an adapter");
    let adapters = kernel(Exp2::Adapter.sources());
    let ulps = worst_ulps(&gpu, &adapters).expect("computes");
    let by_check = Exp2::by_error(ulps);
    for kind in [Cpu, DiscreteGpu, IntegratedGpu, Other, VirtualGpu] {
        gpu.info.device_type = kind;
        let of = |choice| Exp2::of(choice, &gpu).expect("computes");
        let by_rule = match kind {
            Cpu => Exp2::Polynomial,
            _ => by_check,
        };
        assert_eq!(of(Auto), by_rule, "{kind:?}, {ulps}");
        assert_eq!(of(Polynomial), Exp2::Polynomial);
        assert_eq!(of(Adapter), by_check);
    }
    for exp2 in [Exp2::Polynomial, Exp2::Adapter] {
        let choice = exp2.choice();
        assert_eq!(choice == Adapter, exp2 == Exp2::Adapter);
        assert_ne!(choice, Auto);
    }
}

#[test]
fn the_adapters_own_reaches_the_rasterizers_and_changes_little() {
    let own = Exp2::Adapter.sources();
    assert!(own("rasterize", 0).contains("const EXP2_OF_ADAPTER = true;"));
    assert!(compose("rasterize", 0).contains("const EXP2_OF_ADAPTER = false;"));
    let gaussians = gaussians_of(&random_scene(400, 0, 3).gaussians, 0);
    for rasterizer in Rasterizer::ALL {
        let images = [Exp2::Polynomial, Exp2::Adapter].map(|exp2| {
            let gpu = Gpu::open().expect("an adapter");
            let ctx = Context::from_sources(gpu, rasterizer, exp2.sources());
            let mut rig = Rig::new(&ctx, &gaussians, view_of(&cameras()[0]), 0).expect("fits");
            rig.forward(&ctx).expect("renders")
        });
        let pairs = images[0].rgb.iter().zip(&images[1].rgb);
        let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // A splat at the edge of what is drawn may be or not.
        assert!(most < 2e-2, "{rasterizer}: {most}");
    }
}
