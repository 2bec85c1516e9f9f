// Sums the pairs' gradients, first by aligned blocks, in place, so that no thread adds
// up thousands of them in a row: PAIR_BLOCK pairs, then PAIR_BLOCK such blocks, which one workgroup has. A Gaussian's pairs
// lie together, so a block whose first and last pair are of one Gaussian is that Gaussian's alone;
// its sums replace those of its first pair. Other blocks stay as they are, and most are such. Then
// sum_gaussians adds up what is left of each Gaussian.
#import shared/thread
#import shared/view
#import shared/splat
#import shared/splat_gradient
#import shared/entries
#import shared/pair_gradient
#import shared/pair_sums
#import shared/dropout

@group(0) @binding(0) var<storage, read> totals: array<u32>;
@group(0) @binding(1) var<storage, read> pair_gaussian: array<u32>;
@group(0) @binding(2) var<storage, read_write> d_pair_a: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> d_pair_b: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> d_pair_c: array<f32>;
@group(0) @binding(5) var<uniform> view: View;
@group(0) @binding(6) var<storage, read> gaussian_pairs: array<vec2u>;
// Splats, and then their gradients.
@group(0) @binding(7) var<storage, read_write> splats: array<SplatVectors>;
// Front to back.
@group(0) @binding(8) var<storage, read> depth_order: array<DepthEntry>;

// Sums the thread's block of PAIR_BLOCK entries, each the first of `stride` pairs.
fn sum_block(thread: u32, stride: u32) {
    let size = PAIR_BLOCK * stride;
    let n = totals[TOTAL_PAIRS];
    if (totals[TOTAL_OVERFLOW] != 0u || thread >= n / size) {
        return;
    }
    let first = thread * size;
    if (pair_gaussian[first] != pair_gaussian[first + size - 1u]) {
        return;
    }
    var a = d_pair_a[first];
    var b = d_pair_b[first];
    var c = d_pair_c[first];
    // bound: PAIR_BLOCK - 1 turns, a number that a driver must not see: it would write all of them out, and take seconds for it.
    for (var pair = first + stride; pair < first + size; pair += stride) {
        a += d_pair_a[pair];
        b += d_pair_b[pair];
        c += d_pair_c[pair];
    }
    d_pair_a[first] = a;
    d_pair_b[first] = b;
    d_pair_c[first] = c;
}

@compute @workgroup_size(WORKGROUP)
fn sum_pairs(thread: Thread) {
    sum_block(thread_index(thread), 1u);
    storageBarrier();
    if (thread.local % PAIR_BLOCK == 0u) {
        sum_block(thread_index(thread) / PAIR_BLOCK, PAIR_BLOCK);
    }
}

// One thread a Gaussian: the sum of all its pairs, in their fixed order. Neighbours by depth have pairs side by side, and
// about as many.
@compute @workgroup_size(WORKGROUP)
fn sum_gaussians(thread: Thread) {
    let rank = thread_index(thread);
    if (rank >= view.n_gaussians) {
        return;
    }
    let id = depth_order[rank].gaussian;
    let range = range_of(gaussian_pairs[id]);
    // The ranges are another view's if the pairs did not fit.
    if (range.first == range.end || totals[TOTAL_OVERFLOW] != 0u) {
        splats[id].factor_reach = vec4f(0.0);
        return;
    }
    var a = vec4f(0.0);
    var b = vec4f(0.0);
    var c = 0.0;
    // bound: 4 (PAIR_BLOCK - 1) turns and one for PAIR_BLOCK^2 pairs, held by the host.
    for (var pair = range.first; pair < range.end;) {
        a += d_pair_a[pair];
        b += d_pair_b[pair];
        c += d_pair_c[pair];
        pair += n_summed(pair, range.end);
    }
    let d = pair_gradient(a, b, c);
    let s = unpacked(splats[id]);
    splats[id] = packed_gradient(SplatGradient(
        d.x, d.y, d.xx, d.xy, d.yy,
        s.l_xx, s.l_xy, s.l_yy,
        select(vec3f(0.0), d.color, s.color > vec3f(0.0)),
        // d.v = dL/dopacity opacity for the opacity drawn, sigmoid(logit) / (1 - p).
        d.v * (1.0 - kept_share(view) * s.opacity),
    ));
}
