//! Shaders and host held together: every stage validates, and structs, constants and workgroup
//! sizes are the same on both sides.

use std::collections::BTreeMap;
use std::mem::offset_of;

use super::rig::context;
use gspotential::doctor;
use gspotential::doctor::twin::{project, raster};
use gspotential::gpu::constants;
use gspotential::gpu::shader::{STAGES, compose};
use gspotential::render::{
    BinUniform, DepthLossUniform, LossUniform, RadixUniform, ScanUniform, SliceUniform, Splat,
    ViewUniform,
};
use gspotential::train::optimizer::{RearrangeUniform, ResetUniform, StepUniform, StepView};

/// Every stage at every SH degree.
fn variants() -> impl Iterator<Item = (&'static str, u32)> {
    STAGES
        .iter()
        .flat_map(|(stage, _)| (0..4).map(move |degree| (*stage, degree)))
}

fn parse(stage: &str, sh_degree: u32) -> naga::Module {
    let source = compose(stage, sh_degree);
    let module = naga::front::wgsl::parse_str(&source)
        .unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(&source, stage)));
    let flags = naga::valid::ValidationFlags::all();
    // No capability beyond the standard: what every adapter runs.
    naga::valid::Validator::new(flags, naga::valid::Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(&source, stage)));
    module
}

/// Size and (member, offset) of a Rust struct.
type Layout = (usize, Vec<(&'static str, usize)>);

macro_rules! layout {
    ($name:ty: $($field:ident),* $(,)?) => {
        (size_of::<$name>(), vec![$((stringify!($field), offset_of!($name, $field))),*])
    };
}

fn host_layouts() -> BTreeMap<&'static str, Layout> {
    BTreeMap::from([
        (
            "View",
            layout!(ViewUniform: w2c_x, w2c_y, w2c_z, w2c_low_x, w2c_low_y, w2c_low_z,
                center, near, center_low, zero, focal, principal, focal_low, principal_low,
                ratio_min, ratio_max, ratio_min_low, ratio_max_low, background, size, tiles,
                n_gaussians, stride, drop_threshold, drop_key, plane_vectors, row_vectors, slot,
                longest_list, share_base, share_per_distance, share_per_density, compensates,
                near_layer, middle_layer, blended_plane),
        ),
        (
            "Loss",
            layout!(LossUniform: l1_scale, ssim_scale, masked, mean_scale, slot, n_partials,
                far_scale, silhouette_scale),
        ),
        (
            "DepthLoss",
            layout!(DepthLossUniform: weight, patch_weight, normal_weight, kind, plane, inverse,
                patch_vectors, normals),
        ),
        ("Scan", layout!(ScanUniform: n, total, capacity, step)),
        ("Radix", layout!(RadixUniform: n, pairs, shift, counts_next)),
        (
            "Step",
            layout!(StepUniform: views, geometry_rates, sh_0_rate, sh_rate, flat_weight, beta_1, beta_2,
                new_share_1, new_share_2, correction_1, correction_2, epsilon, own_rates, frozen_beyond,
                n_gaussians, stride),
        ),
        (
            "StepView",
            layout!(StepView: center, weight, center_low, pad),
        ),
        (
            "Reset",
            layout!(ResetUniform: ceiling, frozen_beyond, n_gaussians, pad),
        ),
        ("Bin", layout!(BinUniform: emits)),
        ("Slice", layout!(SliceUniform: first)),
        (
            "Splat",
            layout!(Splat: anchor, t_0, l_xx, l_xy, l_yy, reach, color, opacity),
        ),
        (
            "Rearrange",
            layout!(RearrangeUniform: n, old_stride, new_stride, n_planes, kind),
        ),
    ])
}

/// What differs between a shader's struct and the host's.
fn differences(members: &[(String, usize)], span: usize, host: &Layout) -> Vec<String> {
    let mut found = Vec::new();
    if span != host.0 {
        found.push(format!("{span} bytes here, {} on the host", host.0));
    }
    let mut members = members.iter().filter(|(name, _)| !name.starts_with("pad"));
    for (field, offset) in host.1.iter().filter(|(name, _)| !name.starts_with("pad")) {
        match members.next() {
            Some((name, at)) if name == field && at == offset => {}
            other => found.push(format!("{field} at {offset} on the host, {other:?} here")),
        }
    }
    found.extend(members.map(|(name, _)| format!("{name} is not on the host")));
    found
}

#[test]
fn every_stage_validates_and_its_structs_are_laid_out_as_on_the_host() {
    let host = host_layouts();
    let mut met = BTreeMap::new();
    for (stage, degree) in variants() {
        let module = parse(stage, degree);
        for (_, variable) in module.global_variables.iter() {
            if variable.space != naga::AddressSpace::Uniform {
                continue;
            }
            let name = module.types[variable.ty].name.clone().unwrap_or_default();
            let known = host.contains_key(name.as_str());
            assert!(known, "{stage}: uniform `{name}` is not known here");
        }
        for (_, ty) in module.types.iter() {
            let naga::TypeInner::Struct { members, span } = &ty.inner else {
                continue;
            };
            let name = ty.name.clone().expect("structs have names");
            let Some(layout) = host.get(name.as_str()) else {
                continue;
            };
            let members: Vec<(String, usize)> = members
                .iter()
                .map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize))
                .collect();
            let found = differences(&members, *span as usize, layout);
            assert!(found.is_empty(), "{stage}: {name}: {}", found.join("; "));
            // The comparison sees a member that has moved, is missing, and a size that differs.
            let mut moved = members.clone();
            moved[0].1 += 4;
            assert!(!differences(&moved, *span as usize, layout).is_empty());
            assert!(!differences(&members[1..], *span as usize, layout).is_empty());
            assert!(!differences(&members, *span as usize + 16, layout).is_empty());
            *met.entry(name).or_insert(0) += 1;
        }
    }
    let unmet: Vec<_> = host
        .keys()
        .filter(|name| !met.contains_key(**name))
        .collect();
    assert!(unmet.is_empty(), "no stage has {unmet:?}");
}

#[test]
fn every_entry_point_has_the_hosts_workgroup_size() {
    for (stage, degree) in variants() {
        let module = parse(stage, degree);
        assert!(!module.entry_points.is_empty(), "{stage}");
        for point in &module.entry_points {
            assert_eq!(point.stage, naga::ShaderStage::Compute, "{stage}");
            let threads = match stage {
                "ssim_workgroup" => constants::LOSS_GROUP,
                _ => constants::WORKGROUP,
            };
            let size = point.workgroup_size;
            assert_eq!(size, [threads, 1, 1], "{stage}: {}", point.name);
        }
    }
}

#[test]
fn the_doctor_knows_what_the_kernels_need() {
    let (mut storage, mut uniform, mut shared) = (0, 0, 0);
    for (stage, degree) in variants() {
        let module = parse(stage, degree);
        let count = |is: fn(naga::AddressSpace) -> bool| {
            let variables = module.global_variables.iter();
            variables.filter(|(_, v)| is(v.space)).count() as u32
        };
        use naga::AddressSpace::{Storage, Uniform, WorkGroup};
        storage = storage.max(count(|space| matches!(space, Storage { .. })));
        uniform = uniform.max(count(|space| matches!(space, Uniform)));
        let in_workgroup = module
            .global_variables
            .iter()
            .filter(|(_, v)| v.space == WorkGroup);
        let bytes = in_workgroup.map(|(_, v)| module.types[v.ty].inner.size(module.to_ctx()));
        shared = shared.max(bytes.sum());
    }
    assert_eq!(storage, doctor::STORAGE_BUFFERS);
    assert_eq!(uniform, doctor::UNIFORM_BUFFERS);
    assert_eq!(shared, doctor::WORKGROUP_BYTES);
    // Every adapter has these, and the device has no more of them.
    let promised = wgpu::Limits::default();
    assert!(storage <= promised.max_storage_buffers_per_shader_stage);
    assert!(uniform <= promised.max_uniform_buffers_per_shader_stage);
    assert!(shared <= promised.max_compute_workgroup_storage_size);
    assert!(constants::LOSS_GROUP <= promised.max_compute_invocations_per_workgroup);
    let limits = &context().gpu.limits;
    assert_eq!(
        limits.max_storage_buffers_per_shader_stage,
        promised.max_storage_buffers_per_shader_stage
    );
    assert_eq!(
        limits.max_compute_workgroup_storage_size,
        promised.max_compute_workgroup_storage_size
    );
}

#[test]
fn bindings_lie_in_one_group_and_are_not_shared() {
    for (stage, degree) in variants() {
        let mut bindings: Vec<u32> = parse(stage, degree)
            .global_variables
            .iter()
            .filter_map(|(_, v)| v.binding)
            .map(|b| {
                assert_eq!(b.group, 0, "{stage}");
                b.binding
            })
            .collect();
        bindings.sort_unstable();
        let n = bindings.len();
        bindings.dedup();
        assert_eq!(bindings.len(), n, "{stage}: two variables at one binding");
    }
}

#[test]
fn no_stage_holds_a_float_atomic_or_depends_on_subgroups() {
    for (stage, degree) in variants() {
        let module = parse(stage, degree);
        for (_, ty) in module.types.iter() {
            if let naga::TypeInner::Atomic(scalar) = ty.inner {
                assert_ne!(scalar.kind, naga::ScalarKind::Float, "{stage}");
            }
        }
        assert!(!compose(stage, degree).contains("subgroup"), "{stage}");
    }
}

#[test]
fn constants_are_those_of_the_reference() {
    assert_eq!(constants::DILATION, project::DILATION);
    assert_eq!(constants::ALPHA_MAX, raster::ALPHA_MAX);
    assert_eq!(constants::ALPHA_MIN, raster::ALPHA_MIN);
    assert_eq!(constants::TRANSMITTANCE_MIN, raster::TRANSMITTANCE_MIN);
    assert_eq!(constants::SSIM_C1, 0.01 * 0.01);
    assert_eq!(constants::SSIM_C2, 0.03 * 0.03);
    let window = constants::ssim_window();
    let twin = doctor::twin::loss::window();
    for (i, row) in window.iter().enumerate() {
        for (j, column) in window.iter().enumerate() {
            assert!((row * column - twin[i * 11 + j]).abs() < 1e-15);
        }
    }
}

#[test]
fn the_prelude_reaches_the_shaders_with_the_hosts_values() {
    let module = parse("rasterize", 0);
    let value = |name: &str| {
        let (_, constant) = module
            .constants
            .iter()
            .find(|(_, c)| c.name.as_deref() == Some(name))
            .unwrap_or_else(|| panic!("no constant {name}"));
        match module.global_expressions[constant.init] {
            naga::Expression::Literal(naga::Literal::F32(x)) => f64::from(x),
            naga::Expression::Literal(naga::Literal::U32(x)) => f64::from(x),
            ref other => panic!("{name}: {other:?}"),
        }
    };
    for (name, host) in [
        ("WORKGROUP", f64::from(constants::WORKGROUP)),
        ("TILE_W", f64::from(constants::TILE_W)),
        ("TILE_H", f64::from(constants::TILE_H)),
        ("ALPHA_MAX", f64::from(constants::ALPHA_MAX as f32)),
        ("ALPHA_MIN", f64::from(constants::ALPHA_MIN as f32)),
        (
            "TRANSMITTANCE_MIN",
            f64::from(constants::TRANSMITTANCE_MIN as f32),
        ),
        ("DILATION", f64::from(constants::DILATION as f32)),
    ] {
        assert_eq!(value(name), host, "{name}");
    }
}

#[test]
fn a_shared_file_is_taken_in_once() {
    let source = compose("project_backward", 3);
    for part in ["struct View {", "struct Thread {", "struct Splat {"] {
        assert_eq!(source.matches(part).count(), 1, "{part}");
    }
    assert!(!source.contains("#import"));
}
