// Finds the tiles that each splat reaches, for the rasterizers of one workgroup a tile: a thread counts those of a splat, and
// then one writes EMIT_CHUNK pairs of the list. The pairs that a workgroup writes are one block of the sort by tile: it counts
// the digits of that sort's first pass as it writes them.
#import shared/bin
#import shared/radix
#import shared/radix_group

const LIST_W = GROUP_TILE;
const LIST_H = GROUP_TILE;

// As radix_count leaves them.
@group(0) @binding(9) var<storage, read_write> digit_counts: array<u32>;

// Atomic additions count alone, and their order does not matter.
var<workgroup> digits: array<atomic<u32>, DIGITS>;

fn emitted(tile: u32) {
    atomicAdd(&digits[tile & (DIGITS - 1u)], 1u);
}

fn store_digits(thread: Thread) {
    let number = workgroup_index(thread);
    let n_blocks = n_chunks(totals[TOTAL_PAIRS]);
    workgroupBarrier();
    // bound: DIGITS / WORKGROUP turns.
    for (var digit = thread.local; digit < DIGITS; digit += WORKGROUP) {
        if (number < n_blocks) {
            digit_counts[digit * n_blocks + number] = atomicLoad(&digits[digit]);
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn bin(thread: Thread) {
    let index = thread_index(thread);
    let n = view.n_gaussians;
    let counts = mode.emits == COUNT;
    if (!counts && totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    if (!counts && index < n) {
        gaussian_pairs[depth_order[index].gaussian] = stored_range(Range(splat_pairs[index], end_of(index)));
    }
    var pair = select(index * EMIT_CHUNK, 0u, counts);
    let end = select(min(pair + EMIT_CHUNK, totals[TOTAL_PAIRS]), 0xffffffffu, counts);
    let n_splats = select(EMIT_CHUNK, select(0u, 1u, index < n), counts);
    // Counting searches nothing.
    let n_searched = select(n, 0u, counts);
    var rank = select(0u, index, counts);
    // The first search starts with the largest step there is.
    var step = 1u << firstLeadingBit(max(n_searched, 1u));
    var before = 0u;
    // bound: EMIT_CHUNK turns, a splat that the scan names has a pair.
    for (var k = 0u; k < n_splats && pair < end; k++) {
        rank = owner(pair, rank, step, n_searched);
        step = 1u;
        var first = 0u;
        if (!counts) {
            first = splat_pairs[rank];
        }
        before = walk(depth_order[rank].gaussian, first, pair, end, counts);
        pair = min(before, end);
    }
    if (counts && index < n) {
        splat_pairs[index] = before;
    }
    if (!counts) {
        store_digits(thread);
    }
}
