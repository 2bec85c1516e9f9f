// Sums the pairs' gradients to depth and normal as sum_pairs does the others, and carries each Gaussian's
// back to its mean and rotation, behind project_backward, to whose gradients it adds.
#import shared/thread
#import shared/view
#import shared/double
#import shared/gaussian
#import shared/normal
#import shared/entries
#import shared/pair_sums

@group(0) @binding(0) var<storage, read> totals: array<u32>;
@group(0) @binding(1) var<storage, read> pair_gaussian: array<u32>;
@group(0) @binding(2) var<storage, read_write> d_pair_depth: array<vec4f>;
@group(0) @binding(3) var<uniform> view: View;
@group(0) @binding(4) var<storage, read> gaussian_pairs: array<vec2u>;
@group(0) @binding(5) var<storage, read> geometry: array<vec4f>;
// Planes as `geometry`.
@group(0) @binding(6) var<storage, read_write> d_geometry: array<vec4f>;

// Sums the thread's block of PAIR_BLOCK entries, each the first of `stride` pairs.
fn sum_block(thread: u32, stride: u32) {
    let size = PAIR_BLOCK * stride;
    if (totals[TOTAL_OVERFLOW] != 0u || thread >= totals[TOTAL_PAIRS] / size) {
        return;
    }
    let first = thread * size;
    if (pair_gaussian[first] != pair_gaussian[first + size - 1u]) {
        return;
    }
    var d = d_pair_depth[first];
    // bound: PAIR_BLOCK - 1 turns, see sum_pairs.
    for (var pair = first + stride; pair < first + size; pair += stride) {
        d += d_pair_depth[pair];
    }
    d_pair_depth[first] = d;
}

@compute @workgroup_size(WORKGROUP)
fn sum_depth_pairs(thread: Thread) {
    sum_block(thread_index(thread), 1u);
}

@compute @workgroup_size(WORKGROUP)
fn sum_depth_pair_blocks(thread: Thread) {
    sum_block(thread_index(thread), PAIR_BLOCK);
}

// One thread a Gaussian.
@compute @workgroup_size(WORKGROUP)
fn project_depth_backward(thread: Thread) {
    let id = thread_index(thread);
    if (id >= view.n_gaussians) {
        return;
    }
    let range = range_of(gaussian_pairs[id]);
    // The ranges are another view's if the pairs did not fit.
    if (range.first == range.end || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    var d = vec4f(0.0);
    // bound: 4 (PAIR_BLOCK - 1) turns and one for PAIR_BLOCK^2 pairs, held by the host.
    for (var pair = range.first; pair < range.end;) {
        d += d_pair_depth[pair];
        pair += n_summed(pair, range.end);
    }
    let g = gaussian(id);
    let n = normal_of(view, g, to_camera(view, g.mean).hi);
    let d_axis = n.side * (d.x * view.w2c_x.xyz + d.y * view.w2c_y.xyz + d.z * view.w2c_z.xyz);
    let d_rotation = rotation_gradient(
        g.rotation_wxyz,
        select(vec3f(0.0), d_axis, n.axis == 0u),
        select(vec3f(0.0), d_axis, n.axis == 1u),
        select(vec3f(0.0), d_axis, n.axis == 2u),
    );
    let stride = view.stride;
    d_geometry[id] += vec4f(d.w * view.w2c_z.xyz, 0.0);
    d_geometry[2u * stride + id] += d_rotation;
}
