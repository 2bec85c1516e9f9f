//! Counts, offsets and sizes around 2^31 and 2^32.

use glam::{DMat3, DVec3};
use gspotential::camera::Camera;
use gspotential::gpu::{Buffer, binding_limit, commands::fold, shader_count};
use gspotential::render::{Capacity, ViewUniform, Workspace};

use crate::gpu::rig::context;

const TWO_31: u64 = 1 << 31;
const TWO_32: u64 = 1 << 32;

#[test]
fn what_a_kernel_can_bind_is_below_4_gib_on_any_adapter() {
    let limit = |binding, buffer| {
        binding_limit(&wgpu::Limits {
            max_storage_buffer_binding_size: binding,
            max_buffer_size: buffer,
            ..wgpu::Limits::default()
        })
    };
    for bytes in [TWO_31 - 16, TWO_31, TWO_31 + 16, TWO_32 - 16] {
        assert_eq!(limit(bytes, u64::MAX), bytes);
        assert_eq!(limit(u64::MAX, bytes), bytes);
    }
    for bytes in [TWO_32, TWO_32 + 16, 1 << 40, u64::MAX] {
        assert_eq!(limit(bytes, bytes), TWO_32 - 16);
    }
}

#[test]
fn counts_for_shaders_are_whole_or_a_fault() {
    for n in [0, TWO_31 - 1, TWO_31, TWO_31 + 1, TWO_32 - 1] {
        assert_eq!(u64::from(shader_count(n as usize)), n);
    }
    for n in [TWO_32, TWO_32 + 1] {
        assert!(
            std::panic::catch_unwind(|| shader_count(n as usize)).is_err(),
            "{n} is cut"
        );
    }
}

#[test]
fn workgroups_are_folded_without_loss() {
    for n in [TWO_31 - 1, TWO_31, TWO_31 + 1, 65_535 * 65_535] {
        let (columns, rows) = fold(n, 65_535);
        assert!(columns <= 65_535 && rows <= 65_535, "{n}");
        let covered = u64::from(columns) * u64::from(rows);
        assert!(
            (n..n + u64::from(rows)).contains(&covered),
            "{n}: {covered}"
        );
    }
}

#[test]
fn buffers_of_any_length_are_made_or_refused_with_their_size() {
    let ctx = context();
    for len in [
        TWO_31 - 1,
        TWO_31,
        TWO_32 / 16,
        TWO_32 - 1,
        TWO_32,
        1 << 60,
        u64::MAX,
    ] {
        let buffer = Buffer::storage::<[f32; 4]>(&ctx.gpu, "long", len as usize);
        let error = buffer
            .err()
            .expect("more than any adapter binds")
            .to_string();
        assert!(
            error.contains(&format!("needs {len} x 16 bytes")),
            "{error}"
        );
    }
}

/// A camera of this size.
fn camera(width: u32, height: u32) -> Camera {
    Camera {
        name: "large".to_owned(),
        width,
        height,
        fx: 100.0,
        fy: 100.0,
        cx: 50.0,
        cy: 50.0,
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    }
}

#[test]
fn images_of_any_size_are_counted_or_refused() {
    let ctx = context();
    let view = |width, height| ViewUniform::new(&camera(width, height), 0.1, [0.0; 3]);
    // 2^16 columns of four pixels by 2^16 rows are 2^32 vectors.
    for (width, height, vectors) in [
        (1 << 16, 1 << 16, 1 << 30),
        (1 << 17, (1 << 16) - 8, TWO_31 - (1 << 18)),
        (1 << 17, 1 << 16, TWO_31),
        ((1 << 18) - 4, 1 << 16, TWO_32 - (1 << 16)),
        (1 << 18, 1 << 16, TWO_32 - 1),
        (u32::MAX, u32::MAX, TWO_32 - 1),
    ] {
        let view = view(width, height);
        assert_eq!(view.plane_len() as u64, vectors, "{width}x{height}");
        assert_eq!(view.n_pixels() as u64, u64::from(width) * u64::from(height));
        let capacity = Capacity::new(ctx.kernels.rasterizer, 8, 8, &[view]);
        let refused = Workspace::new(&ctx.gpu, capacity, true).err();
        let text = refused.expect("too large").to_string();
        assert!(text.contains("--max-size"), "{text}");
    }
}
