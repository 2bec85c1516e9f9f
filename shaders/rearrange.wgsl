// Applies a densification plan to one block of planes (parameters or Adam moments): Gaussian i of
// the new set is Gaussian `sources[i]` of the old one, changed as `changes[i]` says.
#import shared/thread

struct Rearrange {
    n: u32,
    old_stride: u32,
    new_stride: u32,
    n_planes: u32,
    // GEOMETRY, MOMENTS, RATES, or 1: copied as it is.
    kind: u32,
    pad_0: u32,
    pad_1: u32,
    pad_2: u32,
}

const GEOMETRY = 0u;
const MOMENTS = 2u;
// The statistics of a set that is densified: they start anew but for the last number, the rate's.
const RATES = 3u;

@group(0) @binding(0) var<uniform> rearrange: Rearrange;
@group(0) @binding(1) var<storage, read> old_planes: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> new_planes: array<vec4f>;
// Index of the source; the top bit marks a Gaussian that is new and starts without moments.
@group(0) @binding(3) var<storage, read> sources: array<u32>;
@group(0) @binding(4) var<storage, read> changes: array<Change>;

// What is added to a Gaussian's mean, and to each of its log scales.
struct Change {
    mean: vec3f,
    scale_log: f32,
}

@compute @workgroup_size(WORKGROUP)
fn rearrange_planes(thread: Thread) {
    let id = thread_index(thread);
    if (id >= rearrange.n) {
        return;
    }
    let source = sources[id] & 0x7fffffffu;
    let is_new = sources[id] >= 0x80000000u;
    // bound: planes of a block, at most 5.
    for (var plane = 0u; plane < rearrange.n_planes; plane++) {
        var value = old_planes[plane * rearrange.old_stride + source];
        if (rearrange.kind == GEOMETRY && plane == 0u) {
            value += vec4f(changes[id].mean, 0.0);
        }
        if (rearrange.kind == GEOMETRY && plane == 1u) {
            value += vec4f(vec3f(changes[id].scale_log), 0.0);
        }
        if (rearrange.kind == MOMENTS && is_new) {
            value = vec4f(0.0);
        }
        if (rearrange.kind == RATES) {
            value = vec4f(vec3f(0.0), value.w);
        }
        new_planes[plane * rearrange.new_stride + id] = value;
    }
}
