//! All rasterizers make one image; a rule, not a measurement, chooses among them.

use std::fs;

use gspotential::config::{Config, RasterizerChoice};
use gspotential::doctor::determinism::repeat;
use gspotential::doctor::view::{ViewCase, extreme_cases, large_cases, small_cases};
use gspotential::doctor::{Context, Rig};
use gspotential::gpu::{Exp2, Gpu, Rasterizer};
use gspotential::render::{Rendered, rasterizer_for};

use super::rig::context_of;
use crate::kit::program::succeed;

fn image(ctx: &Context, case: &ViewCase) -> Rendered {
    let mut rig = Rig::of_twin(ctx, &case.gaussians, &case.camera).expect("fits");
    rig.forward(ctx).expect("renders")
}

/// Numbers of two images that differ in any bit.
fn n_different(a: &Rendered, b: &Rendered) -> usize {
    let bits = |image: &Rendered| -> Vec<u32> {
        let values = image.rgb.iter().chain(&image.alpha);
        values.map(|x| x.to_bits()).collect()
    };
    let (a, b) = (bits(a), bits(b));
    assert_eq!(a.len(), b.len());
    a.iter().zip(&b).filter(|(a, b)| a != b).count()
}

#[test]
fn images_of_all_rasterizers_are_equal_to_the_bit() {
    let [thread, workgroup] = Rasterizer::ALL.map(context_of);
    let cases = [small_cases(), extreme_cases(), large_cases()];
    let mut n_drawn = 0;
    for case in cases.iter().flatten() {
        let mut ours = image(&workgroup, case);
        let theirs = image(&thread, case);
        assert_eq!(n_different(&ours, &theirs), 0, "{}", case.name);
        n_drawn += ours.alpha.iter().filter(|a| **a > 0.0).count();
        // The comparison sees the last bit of one number.
        let last = ours.rgb.last_mut().expect("a pixel");
        *last = f32::from_bits(last.to_bits() ^ 1);
        assert_eq!(n_different(&ours, &theirs), 1, "{}", case.name);
    }
    assert!(n_drawn > 10_000, "{n_drawn} pixels are drawn in");
}

#[test]
fn the_choice_follows_the_adapters_kind_unless_it_is_stated() {
    use RasterizerChoice::{Auto, Thread, Workgroup};
    use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, Other, VirtualGpu};
    let mut gpu = Gpu::open().expect("an adapter");
    for kind in [Cpu, DiscreteGpu, IntegratedGpu, Other, VirtualGpu] {
        gpu.info.device_type = kind;
        let by_rule = match kind {
            Cpu => Rasterizer::Thread,
            _ => Rasterizer::Workgroup,
        };
        assert_eq!(Rasterizer::of(Auto, &gpu), by_rule, "{kind:?}");
        assert_eq!(Rasterizer::of(Thread, &gpu), Rasterizer::Thread);
        assert_eq!(Rasterizer::of(Workgroup, &gpu), Rasterizer::Workgroup);
    }
    for rasterizer in Rasterizer::ALL {
        assert_eq!(Rasterizer::of(rasterizer.choice(), &gpu), rasterizer);
        // Reports and configs have one word for it.
        let word = serde_json::to_string(&rasterizer.choice()).expect("a word");
        assert_eq!(word, format!("\"{rasterizer}\""));
        assert_eq!(word, serde_json::to_string(&rasterizer).expect("a word"));
    }
}

#[test]
fn a_cpu_takes_the_larger_tiles_where_small_ones_have_more_pairs_than_fit() {
    use RasterizerChoice::{Auto, Thread, Workgroup};
    let mut gpu = Gpu::open().expect("an adapter");
    gpu.limits.max_storage_buffer_binding_size = 128 << 20;
    let hd = 1600 * 1067;
    for (kind, n, pixels, expected) in [
        (wgpu::DeviceType::Cpu, 30_000, hd, Rasterizer::Thread),
        (wgpu::DeviceType::Cpu, 300_000, hd, Rasterizer::Workgroup),
        (wgpu::DeviceType::Cpu, 1_000_000, hd, Rasterizer::Workgroup),
        (
            wgpu::DeviceType::Cpu,
            1_000_000,
            320 * 213,
            Rasterizer::Thread,
        ),
        (
            wgpu::DeviceType::DiscreteGpu,
            9_000,
            160 * 107,
            Rasterizer::Workgroup,
        ),
    ] {
        gpu.info.device_type = kind;
        let of = |choice| rasterizer_for(choice, &gpu, n, pixels);
        assert_eq!(of(Auto), expected, "{kind:?}, {n}, {pixels}");
        assert_eq!(of(Thread), Rasterizer::Thread);
        assert_eq!(of(Workgroup), Rasterizer::Workgroup);
    }
}

#[test]
fn every_tile_of_any_image_has_a_slot() {
    for rasterizer in Rasterizer::ALL {
        let [width, height] = rasterizer.tile();
        for size in [
            [1, 1],
            [width, height],
            [width + 1, height + 1],
            [1600, 1067],
            [4, 30_000],
        ] {
            let [across, down] = rasterizer.tiles(size);
            assert!(across * width >= size[0] && (across - 1) * width < size[0]);
            assert!(down * height >= size[1] && (down - 1) * height < size[1]);
            assert_eq!(rasterizer.n_tiles(size), (across * down) as usize);
            assert!(rasterizer.n_slots(size) >= rasterizer.n_tiles(size));
            assert_eq!(rasterizer.n_slots(size) % 64, 0);
        }
        // Larger than any count: refused elsewhere, never wrapped.
        assert!(rasterizer.n_slots([u32::MAX; 2]) > u32::MAX as usize);
    }
}

#[test]
fn training_repeats_to_the_bit_with_every_rasterizer() {
    let repeats = Rasterizer::ALL.map(|r| repeat(&context_of(r)).expect("trains"));
    for repeat in &repeats {
        assert!(repeat.holds, "{repeat:?}");
    }
    // They are two trainings: gradients are summed up in another order.
    assert_ne!(repeats[0].hashes[0], repeats[1].hashes[0]);
}

#[test]
fn a_run_records_the_rasterizer_it_was_trained_with() {
    let by_rule = Rasterizer::of(RasterizerChoice::Auto, &Gpu::open().expect("an adapter"));
    let folder = tempfile::tempdir().expect("a folder");
    for (out, setting, expected) in [
        ("ruled", String::new(), by_rule),
        (
            "stated",
            "--set render.rasterizer=workgroup --set render.exp2=adapter".to_owned(),
            Rasterizer::Workgroup,
        ),
    ] {
        let args = format!(
            "train --scene builtin:48 --iterations 2 --set views.count=6 --set scene.n_test=2 \
             --max-points 60 --out {out} {setting}"
        );
        succeed(folder.path(), &args);
        let root = folder.path().join(out);
        let config = Config::from_file(&root.join("config.json")).expect("a config");
        assert_eq!(config.render.rasterizer, expected.choice());
        let gpu = Gpu::open().expect("an adapter");
        let exp2 = Exp2::of(config.render.exp2, &gpu).expect("computes");
        assert_eq!(config.render.exp2, exp2.choice());
        let metrics = fs::read(root.join("metrics.json")).expect("a file");
        let metrics: serde_json::Value = serde_json::from_slice(&metrics).expect("JSON");
        assert_eq!(metrics["rasterizer"], expected.to_string());
        succeed(folder.path(), &format!("eval {out}"));
    }
}
