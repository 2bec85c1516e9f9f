// Sums the pairs' gradients by aligned blocks, in place, so that no thread of project_backward adds
// up thousands of them in a row: PAIR_BLOCK pairs, then PAIR_BLOCK such blocks. A Gaussian's pairs
// lie together, so a block whose first and last pair are of one Gaussian is that Gaussian's alone;
// its sums replace those of its first pair. Other blocks stay as they are, and most are such.
#import shared/thread

@group(0) @binding(0) var<storage, read> totals: array<u32>;
@group(0) @binding(1) var<storage, read> pair_gaussian: array<u32>;
@group(0) @binding(2) var<storage, read_write> d_pair_a: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> d_pair_b: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> d_pair_c: array<f32>;

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
    // bound: PAIR_BLOCK turns.
    for (var i = 1u; i < PAIR_BLOCK; i++) {
        let pair = first + i * stride;
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
}

@compute @workgroup_size(WORKGROUP)
fn sum_pair_blocks(thread: Thread) {
    sum_block(thread_index(thread), PAIR_BLOCK);
}
